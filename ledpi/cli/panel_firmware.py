"""`ledpi panel firmware`: the driver's program for one panel, ready to flash."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ledpi.cli.panel import panel
from ledpi.core.errors import ConfigError
from ledpi.core.str_enum import StrEnum
from ledpi.tools.panel.firmware import Build

if TYPE_CHECKING:
    from ledpi.config.settings import Config
    from ledpi.tools.panel.firmware import Firmware


class PhaseName(StrEnum):
    """`panels.phase`."""

    FREE = "free"
    ANTIPHASE = "antiphase"


@panel.command()
def firmware(
    id_: int = typer.Option(..., "--id", help="ID that the panel shows."),
    out: Path = typer.Option(..., "--out", metavar="FOLDER", help="Folder for the sources: new, or empty."),
    black: float | None = typer.Option(None, "--black", metavar="HZ", help="Default: panels.black_hz."),
    white: float | None = typer.Option(None, "--white", metavar="HZ", help="Default: panels.white_hz."),
    phase: PhaseName | None = typer.Option(
        None, help="antiphase: both classes at one frequency, which --black or --white gives. Default: panels.phase."
    ),
    build: Build = typer.Option(
        Build.TWO_OUTPUTS, help="two-outputs: one pin for each class. sixteen-cells: one for each cell, ID over serial."
    ),
    config: Path | None = typer.Option(None, "--config", help="Default: ./config.yaml, /etc/ledpi/config.yaml."),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Overrides a key of the configuration."),
) -> None:
    """Write a panel driver's program, for an Arduino Uno or Nano.


    The folder gets the sources and, if avr-gcc is installed, the .hex. Dictionary and exposure come from the
    configuration. A frequency is refused if the timer cannot make it to 100 ppm, or if the exposure would average its
    bands away.

    Example: ledpi panel firmware --id 7 --black 1250 --white 2450 --out panel7

    Example: ledpi panel firmware --id 7 --phase antiphase --black 1253.33 --out panel7
    """
    from ledpi.tools.panel.firmware import build_firmware, missing_tools, write_firmware
    from ledpi.tools.panel.firmware_readme import readme_text

    settings = _settings(config, set_)
    planned = _plan(settings, id_, black, white, phase, build)
    write_firmware(planned, readme_text(planned), out)
    for name, half in (("black", planned.black), ("white", planned.white)):
        typer.echo(f"{name}  {half.cycles} cycles  {half.frequency_hz:.4f} Hz  {half.error_ppm:+.1f} ppm")
    missing = missing_tools()
    if missing:
        typer.echo(
            f"{out}: sources; no .hex, as there is no {', '.join(missing)} here "
            f"(Debian: apt install gcc-avr avr-libc make; then make -C {out})"
        )
    else:
        typer.echo(f"{build_firmware(out)}; what to wire and how to flash it: {out / 'README.md'}")
    if note := settings.panels.unreported_note([id_]):
        typer.echo(note)


def _settings(file: Path | None, overrides: list[str]) -> Config:
    from ledpi.config.settings import find_config, load_config

    found = find_config(file)
    size = [] if found is not None else ["panels.side_m=0.16"]  # of no account here
    return load_config(found, tuple(size + overrides))


def _plan(
    settings: Config,
    marker_id: int,
    black: float | None,
    white: float | None,
    phase: PhaseName | None,
    build: Build,
) -> Firmware:
    from ledpi.markers.dictionaries import load_dictionary
    from ledpi.simulate.scene import OV5647_ROW_TIME_US
    from ledpi.simulate.scenes import whole_rows_us
    from ledpi.tools.panel.firmware import plan_firmware

    spec, camera = settings.panels.spec(marker_id), settings.camera
    if (phase or spec.phase) == PhaseName.ANTIPHASE:  # one frequency is enough
        black, white = (white if black is None else black), (black if white is None else white)
    try:
        spec = replace(
            spec,
            black_hz=spec.black_hz if black is None else black,
            white_hz=spec.white_hz if white is None else white,
            phase=spec.phase if phase is None else phase.value,
        )
    except ValueError as error:
        raise ConfigError(f"--black, --white, --phase: {error}") from None
    override = settings.panels.overrides.get(marker_id)
    duty_key = f"panels.overrides.{marker_id}.duty" if override and override.duty is not None else "panels.duty"
    row_time_us = OV5647_ROW_TIME_US if camera.row_time_us == "auto" else camera.row_time_us
    return plan_firmware(
        build,
        load_dictionary(settings.panels.dictionary),
        marker_id,
        spec,
        exposure_us=whole_rows_us(camera.exposure_us, row_time_us),
        scan_time_s=camera.height * row_time_us * 1e-6,
        duty_key=duty_key,
    )
