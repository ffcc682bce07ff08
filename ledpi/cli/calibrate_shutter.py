"""`ledpi calibrate shutter`: row time and exposure, from a panel with a crystal → config.yaml and camera.yaml."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import typer

from ledpi.cli import CONFIG, SET, progress
from ledpi.cli.calibrate import calibrate, change, settings_for
from ledpi.config.settings import Config
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import CalibrationError, RowTimeUnknownError
from ledpi.core.records import Floats, PanelSpec
from ledpi.pipeline.pipeline import Pipeline
from ledpi.workshop.calibrate.bands import PanelLight
from ledpi.workshop.calibrate.files import Key, check_writable
from ledpi.workshop.calibrate.shutter import Reported, ShutterCalibration, measure_shutter
from ledpi.workshop.calibrate.still_panels import measure_still, reads
from ledpi.workshop.calibrate.taking import Taken, take_frames

FIRST_ROW_TIME_US = 30.0  # of a camera that does not tell; sensors' rows take 5 to 100


@calibrate.command()
def shutter(
    recording: Path | None = typer.Argument(None, metavar="RECORDING", help="Default: the configured camera, live."),
    frames: int = typer.Option(120, min=20, max=300, help="Frames to take."),
    dry_run: bool = typer.Option(False, "--dry-run", help="Measure, and write nothing."),
    config: Path | None = CONFIG,
    set_: list[str] = SET,
) -> None:
    """Row time and real exposure, measured with a panel.

    The panel's frequencies must be exact, as from a crystal. Keep camera and panel still, about a metre apart. If the
    driver misreports the row time, or does not know it (USB cameras), the measured one goes to camera.row_time_us in
    config.yaml. camera.yaml, if there is one, also gets what was measured. Older files are kept.

    Example: ledpi calibrate shutter --set panels.black_hz=1250 --set panels.white_hz=2450
    """
    settings, file = settings_for(config, set_, recording)
    if not dry_run:
        check_writable(*(path for path in (file, settings.camera.intrinsics) if path is not None))
    with progress("taking frames", frames) as advance:
        taken, is_told = _take(settings, frames, advance)
    reported = Reported(
        row_time_us=taken.camera.row_time_us / taken.row_time_ratio if is_told else None,
        exposure_us=taken.frames[0].exposure_us / taken.row_time_ratio,
        frame_length_rows=taken.camera.frame_length_rows if is_told else None,
    )
    result = _measure(taken, reported)
    _report(result, reported)
    _write(result, reported, None if dry_run else file)
    if not dry_run and settings.camera.intrinsics is not None:
        _note(settings.camera.intrinsics, result)


def _take(settings: Config, frames: int, advance: Callable[[int], None]) -> tuple[Taken, bool]:
    """Frames, and whether camera or configuration tell a row's time. Where none does, any will do to find a panel."""
    try:
        return take_frames(settings, frames, advance), True
    except RowTimeUnknownError:
        begun = settings.camera.model_copy(update={"row_time_us": FIRST_ROW_TIME_US})
        return take_frames(settings.model_copy(update={"camera": begun}), frames, advance), False


def _measure(taken: Taken, reported: Reported) -> ShutterCalibration:
    """By the first square, from the largest on, that is such a panel and that the decoder reads at the new row time."""

    def measure(light: PanelLight, announced: PanelSpec, corners: Floats) -> ShutterCalibration:
        result = measure_shutter(light, load_dictionary(taken.panels.dictionary), announced, reported)
        if not _reads(taken, result, corners):
            raise CalibrationError(f"bands like those of panel {result.id}, but the decoder does not read it")
        return result

    return measure_still(taken, measure, most=1)[0][0]


def _reads(taken: Taken, result: ShutterCalibration, corners: Floats) -> bool:
    """Tells whether the decoder reads the panel with the shutter as it was measured."""
    row_us, exposure_us = result.row_time_us.value, taken.frames[0].exposure_us
    if result.exposure_us is not None:
        exposure_us = result.exposure_us.value
    camera = replace(taken.camera, row_time_us=row_us, exposure_us=exposure_us)
    frames = [replace(frame, row_time_us=row_us, exposure_us=exposure_us) for frame in taken.frames]
    return reads(frames, Pipeline(camera, taken.panels, intrinsics=taken.intrinsics), result.id, corners)


def _report(result: ShutterCalibration, reported: Reported) -> None:
    row, bands, interval = result.row_time_us, result.by_bands_us, result.by_interval_us
    typer.echo(f"panel {result.id}")
    report = "does not report one" if reported.row_time_us is None else f"says {reported.row_time_us:.3f} µs"
    typer.echo(f"  row time  {row.value:.3f} ± {row.sigma:.3f} µs; the driver {report}")
    typer.echo(f"            by the bands {bands.value:.3f} ± {bands.sigma:.3f} µs")
    over = f"            by the frames' interval over {reported.frame_length_rows} rows"
    if interval is not None:
        typer.echo(f"{over} {interval.value:.3f} µs")
    elif reported.frame_length_rows is not None:
        typer.echo(f"{over} another one: a scaled picture?")
    exposure = result.exposure_us
    said = f"the driver says {reported.exposure_us:.0f} µs"
    if exposure is None:
        typer.echo(f"  exposure  cannot be measured from these bands; {said}")
    else:
        typer.echo(f"  exposure  {exposure.value:.0f} ± {exposure.sigma:.0f} µs; {said}")
    if reported.row_time_us is not None and not row.agrees_with(reported.row_time_us):
        typer.echo(f"  the driver misreports its row time by {reported.row_time_us / row.value - 1:+.1%}")
    if exposure is not None and abs(exposure.value - reported.exposure_us) > max(row.value, 4 * exposure.sigma):
        typer.echo(f"  the driver misreports its exposure by {reported.exposure_us / exposure.value - 1:+.1%}")


def _write(result: ShutterCalibration, reported: Reported, file: Path | None) -> None:
    row_time_us = round(result.row_time_us.value, 3)
    if reported.row_time_us is not None and result.row_time_us.agrees_with(reported.row_time_us):
        typer.echo("the driver's row time is right: nothing to write")
    elif file is None:
        typer.echo(f"nothing written; for config.yaml: camera.row_time_us: {row_time_us}")
    else:
        typer.echo(change(file, {("camera", "row_time_us"): row_time_us}, f"camera.row_time_us: {row_time_us}"))


def _note(camera_yaml: Path, result: ShutterCalibration) -> None:
    """Notes what was measured, and when, beside the lens."""
    values = {"row_time_us": result.row_time_us.value, "row_time_sigma_us": result.row_time_us.sigma}
    if result.exposure_us is not None:
        values |= {"exposure_us": result.exposure_us.value, "exposure_sigma_us": result.exposure_us.sigma}
    notes: dict[Key, Any] = {("ledpi", "shutter", key): round(value, 3) for key, value in values.items()}
    notes[("ledpi", "shutter", "measured")] = date.today()
    typer.echo(change(camera_yaml, notes, "ledpi.shutter"))
