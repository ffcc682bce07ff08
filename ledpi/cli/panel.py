"""`ledpi panel …`: designs, draws and drives the panels; `panel design` is in a file of its own."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ledpi.camera.simulate.scene import OV5647_ROW_TIME_US
from ledpi.camera.simulate.scenes import whole_rows_us
from ledpi.cli import CONFIG, SET, app, progress
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import Config, find_config, load_config
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import ConfigError, raising
from ledpi.core.wording import StrEnum, install_command
from ledpi.workshop.panel.body import Body
from ledpi.workshop.panel.circuit import Circuit, Lamps, PinCircuit, plan_circuit, plan_pins
from ledpi.workshop.panel.firmware import (
    SINGLE_CELLS,
    Build,
    Firmware,
    build_firmware,
    missing_tools,
    plan_firmware,
    write_firmware,
)

if TYPE_CHECKING:
    from ledpi.workshop.panel.sheet import Sheet


panel = typer.Typer(
    help="Design and build panels.\n\nExample: ledpi panel sheet 7 --out sheet",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(panel, name="panel")


OWN_SIZE = ("panels.side_m=0.16",)  # where no configuration has it
_SUPPLY_V, _LED_MA, _PIN_LED_MA = 12.0, 20.0, 7.5


def require_extra(what: str, *packages: str) -> None:
    """Raises ConfigError, with the way to get it, where one of these packages, which are optional, is missing."""
    missing = next((name for name in packages if find_spec(name) is None), None)
    if missing is not None:
        raise ConfigError(f"{what}: must have {missing}, which is not installed: {install_command('panel')}")


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
    config: Path | None = CONFIG,
    set_: list[str] = SET,
) -> None:
    """Write a panel driver's program, for an Arduino Uno or Nano.


    The folder gets the sources and, if avr-gcc is installed, the .hex. Dictionary and exposure come from the
    configuration. A frequency is refused if the timer cannot make it to 100 ppm, or if the exposure would average its
    bands away.

    Example: ledpi panel firmware --id 7 --black 1250 --white 2450 --out panel7

    Example: ledpi panel firmware --id 7 --phase antiphase --black 1253.33 --out panel7
    """
    settings = load_config(find_config(config), tuple(set_), without_file=OWN_SIZE)
    planned = _plan(settings, id_, black, white, phase, build)
    write_firmware(planned, out)
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


def _plan(
    settings: Config, marker_id: int, black: float | None, white: float | None, phase: PhaseName | None, build: Build
) -> Firmware:
    spec, camera = settings.panels.spec(marker_id), settings.camera
    if (phase or spec.phase) == PhaseName.ANTIPHASE:  # one frequency is enough
        black, white = (white if black is None else black), (black if white is None else white)
    with raising("--black, --white, --phase", ConfigError):
        spec = replace(
            spec,
            black_hz=spec.black_hz if black is None else black,
            white_hz=spec.white_hz if white is None else white,
            phase=spec.phase if phase is None else phase.value,
        )
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


@panel.command()
def sheet(
    ids: list[int] = typer.Argument(metavar="ID…", help="IDs of the panels."),
    out: Path = typer.Option(..., "--out", metavar="FOLDER", help="Folder for panel-ID.pdf, SVG, DXF and STL."),
    direct: bool = typer.Option(
        False, "--direct", help="One LED a cell, straight from the sixteen pins of an Uno: no MOSFETs, no supply."
    ),
    supply: float | None = typer.Option(None, min=1, metavar="V", help="Supply of the LEDs. Default: 12."),
    leds: int | None = typer.Option(
        None, help="LEDs in series in each cell. Default: as many as the supply carries, 4 at most."
    ),
    led_voltage: float = typer.Option(3.2, min=1, max=60, metavar="V", help="Forward voltage of one LED."),
    led_ma: float | None = typer.Option(
        None, min=0.1, max=3000, metavar="MA", help="LED current while on. Default: 20; with --direct 7.5."
    ),
    side: float | None = typer.Option(None, min=0.01, max=10, metavar="M", help="Default: panels.side_m."),
    config: Path | None = CONFIG,
    set_: list[str] = SET,
) -> None:
    """Draw wiring and build sheets, true to scale.


    The sheet has the classes from both sides, the circuit, the parts, and the panel at 1 : 1, on several pages if one
    is too small. Front, back and walls are also written as DXF for a laser cutter, and the walls as STL for a 3D
    printer, all in millimetres. Dictionary, size and frequencies come from the configuration.

    Example: ledpi panel sheet 7 23 --out sheets --supply 12 --led-ma 15

    Example: ledpi panel sheet 7 --direct --side 0.12 --out sheet
    """
    overrides = (*set_, *([f"panels.side_m={side}"] if side is not None else []))
    panels = load_config(find_config(config), overrides, without_file=OWN_SIZE).panels
    require_extra("build sheets", "matplotlib", "schemdraw")
    from ledpi.workshop.panel.sheet import write_sheet

    lamps: Lamps | PinCircuit
    if direct:
        _check_direct(supply, leds)
        lamps = plan_pins(led_voltage, 1e-3 * (led_ma or _PIN_LED_MA))
    else:
        supply_v, current_a = supply or _SUPPLY_V, 1e-3 * (led_ma or _LED_MA)
        lamps = Lamps(supply_v=supply_v, leds=leds, forward_v=led_voltage, current_a=current_a)
    sheets = [_planned(panels, marker_id, lamps) for marker_id in dict.fromkeys(ids)]
    with progress("drawing", len(sheets)) as advance:
        for planned in sheets:
            typer.echo(str(write_sheet(planned, out)))
            advance(1)
    if note := panels.unreported_note(ids):
        typer.echo(note)


def _check_direct(supply: float | None, leds: int | None) -> None:
    if supply is not None:
        raise ConfigError(f"--supply {supply:g}: with --direct the Arduino's USB gives the LEDs 5 V; leave it out")
    if leds not in (None, 1):
        raise ConfigError(f"--leds {leds}: a pin's 5 V carry one LED; must be 1 with --direct")


def _planned(panels: PanelSettings, marker_id: int, lamps: Lamps | PinCircuit) -> Sheet:
    from ledpi.workshop.panel.sheet import Sheet

    dictionary, spec = load_dictionary(panels.dictionary), panels.spec(marker_id)
    with raising(f"ID {marker_id}", ConfigError):
        dictionary.check_readable(marker_id, spec.phase)
        codeword = dictionary.codeword(marker_id)
    circuit: Circuit | PinCircuit
    if isinstance(lamps, PinCircuit):
        if codeword.size != SINGLE_CELLS:
            raise ConfigError(
                f"--direct: an Uno has pins for {SINGLE_CELLS} cells, {dictionary.name} has {codeword.size}"
            )
        circuit, leds = lamps, 1
    else:
        white = int(codeword.sum())
        circuit = plan_circuit(lamps, (codeword.size - white, white))
        leds = circuit.leds
    body = Body(codeword=codeword, side_mm=round(1e3 * spec.side_m, 3), leds=leds)
    return Sheet(dictionary=dictionary, marker_id=marker_id, spec=spec, circuit=circuit, body=body)
