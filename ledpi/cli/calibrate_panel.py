"""`ledpi calibrate panel`: what a panel really blinks at → panels.overrides in config.yaml."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import Any

import typer

from ledpi.camera.base import frame_by
from ledpi.camera.recording.picture import SUFFIXES, still_camera
from ledpi.cli import CONFIG, SET, progress
from ledpi.cli.calibrate import calibrate, change, read_grey, settings_for
from ledpi.config.panels import PanelOverride, PanelSettings
from ledpi.config.settings import Config
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import CalibrationError
from ledpi.core.records import Floats, PanelSpec
from ledpi.core.shutter import contrast
from ledpi.pipeline.pipeline import Pipeline
from ledpi.workshop.calibrate.bands import ClassBands, PanelLight
from ledpi.workshop.calibrate.files import Key, check_writable
from ledpi.workshop.calibrate.lamp import lamp_frequency, lamp_rows
from ledpi.workshop.calibrate.panel import MAX_LIGHT_SHARE, PanelCalibration, advice, frequency_sigma_hz, measure_panel
from ledpi.workshop.calibrate.still_panels import measure_still, reads, steady_seconds
from ledpi.workshop.calibrate.taking import Taken, take_frames


@calibrate.command()
def panel(
    paths: list[Path] | None = typer.Argument(
        None, metavar="RECORDING|PICTURE…", help="Default: the configured camera, live."
    ),
    frames: int = typer.Option(120, min=20, max=300, help="Frames to take."),
    dry_run: bool = typer.Option(False, "--dry-run", help="Measure, and write nothing."),
    config: Path | None = CONFIG,
    set_: list[str] = SET,
) -> None:
    """Measure what the panels in view really blink at → config.yaml.

    The frequencies go to panels.overrides; the older file is kept. Keep camera and panel still, about a metre apart.
    The command searches within 15 % of the configured (or recorded) frequencies. If a panel blinks as configured,
    only the date is written. The command also says if the exposure or the frame period suits these frequencies badly,
    and which would be better.

    With photographs, each of one blinking lamp, it prints the frequency to a tenth of a percent and writes nothing: a
    first look at an LED and its driver.

    Example: ledpi calibrate panel --frames 120
    """
    if paths and all(path.suffix.lower() in SUFFIXES for path in paths):
        _measure_lamps(paths, settings_for(config, set_, None)[0])
        return
    if paths and len(paths) > 1:
        raise CalibrationError("one recording at a time, or only pictures")
    settings, file = settings_for(config, set_, paths[0] if paths else None)
    if file is not None and not dry_run:
        check_writable(file)
    with progress("taking frames", frames) as advance:
        taken = take_frames(settings, frames, advance)
    measured = _measure(taken)
    # A recording may announce what the configuration does not, by which the daemon will read this panel.
    for result, corners in measured:
        _report(result, corners, settings.panels.spec(result.id), taken)
    _write({r.id: r for r, _ in measured}, settings.panels, None if dry_run else file)


def _measure_lamps(paths: list[Path], settings: Config) -> None:
    camera = still_camera(settings.camera)
    seen = 0
    for path in paths:
        light = lamp_rows(frame_by(camera, read_grey(path)))
        hz = lamp_frequency(light, exposure_us=camera.exposure_us, row_time_us=camera.row_time_us)
        seen += hz is not None
        typer.echo(f"{path}  " + (f"{hz.value:.1f} ± {hz.sigma:.1f} Hz" if hz is not None else "no lamp with bands"))
    if not seen:
        raise CalibrationError("no lamp with bands in any picture; camera.exposure_us must be that of the pictures")


def _measure(taken: Taken) -> list[tuple[PanelCalibration, Floats]]:
    """Each panel in view as measured and read again by the decoder, with its corners."""

    def measure(light: PanelLight, announced: PanelSpec, corners: Floats) -> PanelCalibration:
        result = measure_panel(
            light,
            load_dictionary(taken.panels.dictionary),
            announced,
            exposure_us=taken.frames[0].exposure_us,
            row_time_us=taken.camera.row_time_us,
        )
        _check_that_it_reads(taken, result, corners)
        return result

    try:
        return measure_still(taken, measure)
    except CalibrationError as error:
        hints = _advice((taken.panels.black_hz, taken.panels.white_hz), taken)
        raise CalibrationError("; ".join([str(error), *hints])) from None


def _check_that_it_reads(taken: Taken, result: PanelCalibration, corners: Floats) -> None:
    panels = taken.panels
    known = panels.overrides.get(result.id, PanelOverride()).model_copy(update=result.overrides(panels.spec(result.id)))
    with_it = panels.model_copy(update={"overrides": {result.id: known}})
    pipeline = Pipeline(taken.camera, with_it, intrinsics=taken.intrinsics)
    if reads(taken.frames, pipeline, result.id, corners):
        return
    found = f"{result.black.frequency_hz:.1f} and {result.white.frequency_hz:.1f} Hz"
    why = f"is it of {panels.dictionary}?"
    if max(result.blinking_share) > MAX_LIGHT_SHARE:
        why = f"no exposure of {taken.frames[0].exposure_us:.0f} µs leaves them so deep; see `ledpi calibrate shutter`"
    raise CalibrationError(f"bands like those of panel {result.id} at {found}, but the decoder does not read it: {why}")


def _advice(frequencies_hz: tuple[float, float], taken: Taken) -> list[str]:
    return advice(
        tuple(dict.fromkeys(frequencies_hz)),
        exposure_us=taken.frames[0].exposure_us,
        row_time_us=taken.camera.row_time_us,
        frame_interval_us=steady_seconds(taken.frames)[1],
    )


def _report(result: PanelCalibration, corners: Floats, announced: PanelSpec, taken: Taken) -> None:
    height = corners[:, 1].max() - corners[:, 1].min()
    typer.echo(f"panel {result.id}: {height:.0f} px high, {len(taken.frames)} frames")
    exposure_us = taken.frames[0].exposure_us
    duty = announced.duty if result.duty is None else result.duty
    for name, bands, hz, share in (
        ("black", result.black, announced.black_hz, result.blinking_share[0]),
        ("white", result.white, announced.white_hz, result.blinking_share[1]),
    ):
        typer.echo(f"  {name}  {_class_text(bands, hz, exposure_us, duty, share)}")
    if result.duty is None:
        typer.echo("  duty   does not show at this exposure")
    else:
        typer.echo(f"  duty   {result.duty:.3f} ± {result.duty_sigma:.3f}")
    if max(result.blinking_share) > MAX_LIGHT_SHARE:
        typer.echo(f"  an exposure of {exposure_us:.0f} µs leaves no bands so deep: see `ledpi calibrate shutter`")
    for line in _advice((result.black.frequency_hz, result.white.frequency_hz), taken):
        typer.echo(f"  {line}")


def _class_text(bands: ClassBands, announced_hz: float, exposure_us: float, duty: float, share: float) -> str:
    depth = contrast(bands.frequency_hz, exposure_us, duty) * share
    off = bands.frequency_hz / announced_hz - 1
    wander = f", wanders by {bands.wander_hz:.1f} Hz (no crystal?)" if bands.wander_hz > 0 else ""
    return (
        f"{bands.frequency_hz:.2f} ± {frequency_sigma_hz(bands):.2f} Hz ({off:+.2%} of {announced_hz:g}){wander}, "
        f"bands {depth:.1%} deep, {share:.0%} of what all of the light would give"
    )


def _write(measured: dict[int, PanelCalibration], panels: PanelSettings, file: Path | None) -> None:
    changes: dict[Key, Any] = {}
    for marker_id, result in measured.items():
        values: dict[str, Any] = {"measured": date.today()}
        if result.differs_from(panels.spec(marker_id)):
            values = result.overrides(panels.spec(marker_id)) | values
        else:
            typer.echo(f"panel {marker_id} blinks as configured: only the date is written")
        changes |= {("panels", "overrides", marker_id, key): value for key, value in values.items()}
    if file is None:
        typer.echo("nothing written; for config.yaml:")
        for key, value in changes.items():
            typer.echo(f"  {'.'.join(map(str, key))}: {value}")
    else:
        typer.echo(change(file, changes, "panels.overrides"))
