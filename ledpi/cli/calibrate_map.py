"""`ledpi calibrate map`: one drive past the panels → markers.yaml and a picture of it."""

from __future__ import annotations

import math
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import typer

from ledpi.camera.recorded import RecordingCamera, load_recording_with
from ledpi.cli import CONFIG, SET, progress
from ledpi.cli.calibrate import calibrate, name_in_config, settings_for
from ledpi.config.camera_yaml import lens_of
from ledpi.config.map_yaml import map_text
from ledpi.config.settings import Config
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import CalibrationError, raising
from ledpi.core.geometry import FACING_FROM_MARKER, matrix_from_rpy_deg, transform
from ledpi.core.records import Frame, Intrinsics
from ledpi.core.wording import install_command
from ledpi.pipeline.pipeline import Pipeline
from ledpi.workshop.calibrate.files import check_with_picture, check_writable, picture_beside, write_keeping_old
from ledpi.workshop.calibrate.map_views import View, view_of

if TYPE_CHECKING:
    from ledpi.workshop.calibrate.map import MapCalibration


@calibrate.command("map")
def map_(
    recording: Path = typer.Argument(metavar="RECORDING", help="A drive past the panels, recorded."),
    out: Path = typer.Option(Path("markers.yaml"), help="File to write; an older one is kept as NAME.bak-1."),
    origin: int | None = typer.Option(None, help="ID of the panel at the map's origin. Default: the lowest."),
    position: tuple[float, float, float] = typer.Option((0, 0, 0), help="Position of that panel: x y z in metres."),
    yaw_deg: float = typer.Option(0, help="Direction that it faces: 0 along x, 90 along y."),
    config: Path | None = CONFIG,
    set_: list[str] = SET,
) -> None:
    """A drive past the panels → markers.yaml.

    It holds standard deviations, too; a picture of the map from above is written beside it. If the configuration
    names no map, the new one is entered there. Drive slowly, so that each panel is seen together with its neighbours,
    from several places. Without --position and --yaw-deg the origin panel is at 0 0 0, and the map's x axis points
    straight out of it. The origin panel must hang upright.

    Example: ledpi calibrate map drive --origin 7 --position 4 1.2 1.5 --yaw-deg 180
    """
    try:  # what is missing is told before the long work
        from ledpi.workshop.calibrate.map import calibrate_map
        from ledpi.workshop.plan import map_picture
    except ImportError as error:
        raise CalibrationError(f"{error.name} is missing: {install_command('calibrate')}") from None
    if not all(math.isfinite(value) for value in (*position, yaw_deg)):
        raise CalibrationError("--position, --yaw-deg: must be finite numbers")
    check_with_picture(out)
    settings, file = settings_for(config, set_, recording)
    if file is not None and settings.map is None:
        check_writable(file)
    views, sides_m, lens = _drive(recording, settings)
    map_from_origin = transform(matrix_from_rpy_deg(0, 0, yaw_deg) @ FACING_FROM_MARKER, np.array(position))
    with raising(recording, CalibrationError, CalibrationError):
        upright = settings.panels.upright
        result = calibrate_map(views, map_from_origin, sides_m, lens, origin, upright=upright)
    _report(result, len(views))
    _write(result, map_picture(result), out, recording)
    typer.echo(_named(settings, file, out))


def _drive(recording: Path, settings: Config) -> tuple[list[View], dict[int, float], Intrinsics]:
    """Reads a drive: what each frame shows, every panel's size, and the lens."""
    loaded = load_recording_with(settings, recording)
    camera = RecordingCamera(loaded, paced=False)
    views: list[View] = []
    with closing(camera):
        lens = lens_of(camera.info, settings.camera.intrinsics)
        if lens is None:
            raise CalibrationError(f"{recording}: has no lens, and camera.intrinsics is not set: no poses, no map")
        pipeline = Pipeline(camera.info, settings.panels, intrinsics=lens, source_panel=camera.panel)
        with progress("decoding", len(loaded.frames)) as advance:
            while (frame := camera.read(np.empty((camera.info.height, camera.info.width), np.uint8))) is not None:
                if isinstance(frame, Frame):
                    views.append(view_of(frame, pipeline.decode(frame).markers))
                advance(1)
    known = len(load_dictionary(pipeline.panels.dictionary).codewords)
    return views, {i: pipeline.panels.spec(i).side_m for i in range(known)}, lens


def _report(result: MapCalibration, frames: int) -> None:
    typer.echo("  ID       x       y       z m   deviation")
    for marker_id, panel in sorted(result.panels.items()):
        x, y, z = panel.map_from_marker[:3, 3]
        deviation = f"{100 * panel.position_sigma_m:5.1f} cm  {math.degrees(panel.angle_sigma_rad):.2f}°"
        held = "  the origin" if marker_id == result.origin else ""
        typer.echo(f"{marker_id:4} {x:7.3f} {y:7.3f} {z:7.3f}     {deviation}{held}")
    for marker_id in result.unconnected:
        typer.echo(f"{marker_id:4}  left out: no frame shows it together with a panel that leads to the origin")
    adjusted = result.adjusted
    typer.echo(
        f"{frames} frames, {result.views} used; corners fit to {adjusted.rms_px:.2f} px rms, "
        f"{adjusted.outliers:.1%} of the views are contradicted"
    )


def _write(result: MapCalibration, drawn: bytes, out: Path, recording: Path) -> None:
    comment = (
        f"Panels as `ledpi calibrate map` placed them from {recording.name}; panel {result.origin} is the origin.\n"
        f"Deviations are relative to it."
    )
    picture = picture_beside(out)
    kept = write_keeping_old(out, map_text(result.panels, comment))
    write_keeping_old(picture, drawn)
    typer.echo(f"{out} and {picture} written" + (f"; the older ones are kept ({kept})" if kept else ""))


def _named(settings: Config, file: Path | None, out: Path) -> str:
    """Puts the map into a configuration that names none; else says what the daemon will read."""
    if file is None:
        return f"no config.yaml names it: map: {out}"
    if settings.map is None:
        return name_in_config(file, ("map",), out)
    if settings.map.resolve() == out.resolve():
        return f"{file} names it; a daemon that runs reads it again after SIGHUP (sudo systemctl reload ledpi)"
    return f"{file} names another map, {settings.map}; to use this one: map: {out.resolve()}"
