"""`ledpi calibrate camera`: views of a board, live or from pictures → camera.yaml."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from datetime import date
from enum import Enum
from pathlib import Path
from typing import Any

import cv2
import typer

from ledpi.camera.base import Camera
from ledpi.camera.factory import open_camera
from ledpi.camera.recording.format import HEADER_FILE
from ledpi.camera.recording.picture import SUFFIXES
from ledpi.cli import CONFIG, SET, progress
from ledpi.cli.calibrate import (
    DEFAULT_COLS,
    DEFAULT_KIND,
    DEFAULT_ROWS,
    calibrate,
    name_in_config,
    older,
    read_grey,
    settings_for,
)
from ledpi.config.camera_yaml import camera_yaml_text, own_section
from ledpi.config.settings import Config
from ledpi.core.errors import CalibrationError, counted, raising
from ledpi.workshop.calibrate.boards import Board, BoardFinder, BoardView, Kind, other_board
from ledpi.workshop.calibrate.camera import CameraCalibration, calibrate_camera, parameters
from ledpi.workshop.calibrate.camera import quality as quality_of
from ledpi.workshop.calibrate.collecting import corner_counts, draw_coverage, places_without_corners
from ledpi.workshop.calibrate.files import check_with_picture, check_writable, picture_beside, write_keeping_old
from ledpi.workshop.calibrate.taking import collect_views


class ModelName(str, Enum):
    """The models of a lens, as `camera.yaml` names them."""

    plumb_bob = "plumb_bob"
    rational_polynomial = "rational_polynomial"
    thin_prism = "thin_prism"
    equidistant = "equidistant"


MIN_OTHER_BOARD_PICTURES = 3  # that show the same other board, and none the right one: it is another


@calibrate.command()
def camera(
    folder: Path | None = typer.Argument(
        None, metavar="FOLDER", help="Folder of pictures, or a recording. Default: the camera, live."
    ),
    kind: Kind = typer.Option(DEFAULT_KIND, "--board", help="As `ledpi calibrate board` prints them."),
    cols: int = typer.Option(DEFAULT_COLS, min=3, max=20, help="Inner corners along the board's one side."),
    rows: int = typer.Option(DEFAULT_ROWS, min=3, max=20, help="Inner corners along the other."),
    model: ModelName | None = typer.Option(None, "--model", help="Lens model. Default: the one that the views need."),
    out: Path = typer.Option(Path("camera.yaml"), help="File to write; an older one is kept as NAME.bak-1."),
    config: Path | None = CONFIG,
    set_: list[str] = SET,
) -> None:
    """Views of a ChArUco board or chessboard → camera.yaml.

    The file has ROS's camera_info form; a picture of the views is written beside it. If the configuration names no
    lens, the new one is entered there, unless the views come from a recording or the simulator.

    Live, it says how to hold the board next, sets exposure and gain for it, and takes each view once the board is
    still. Ctrl-C ends early. A recording is searched for views in the same way. Pictures in a folder must be from
    this camera, at the width and height in config.yaml: 15 or more, all over the field of view, tilted by 20° to 40°
    to different sides. Views that contradict the others are named and left out. The squares' size does not matter.

    Example: ledpi calibrate camera pictures --board chessboard --cols 9 --rows 6
    """
    check_with_picture(out)
    board = Board(columns=cols, rows=rows, kind=kind)
    is_recording = folder is not None and (folder / HEADER_FILE).is_file()
    settings, file = settings_for(config, set_, folder if is_recording else None)
    pictures = None if is_recording else folder
    if pictures is None and _is_replay(settings):
        file = None  # a simulated lens, or one of any camera: not this robot's
    if file is not None and settings.camera.intrinsics is None:
        check_writable(file)
    found = _live_views(settings, board) if pictures is None else _views_in(pictures, board)
    with raising(f"{folder or 'live'}", CalibrationError, CalibrationError):
        result = calibrate_camera(found.views, found.board, *found.size, None if model is None else model.value)
    written = _write(out, result)
    typer.echo(f"{found.pictures} pictures, {len(found.views)} with the board")
    _report(result)
    for line in [*written, _name_in_config(settings, file, out, found.size)]:
        typer.echo(line)


@dataclass(frozen=True)
class _Found:
    pictures: int
    views: list[BoardView]
    board: Board  # as its maker laid it out
    size: tuple[int, int]  # width and height of all pictures


def _is_replay(settings: Config) -> bool:
    return settings.camera.source.partition(":")[0] in ("simulated", "recording")


def _live_views(settings: Config, board: Board) -> _Found:
    replay = _is_replay(settings)

    def open_at(exposure: tuple[float, float] | None) -> Camera:
        if exposure is None:
            return open_camera(settings, paced=not replay)
        changed = settings.camera.model_copy(update={"exposure_us": exposure[0], "analogue_gain": exposure[1]})
        return open_camera(settings.model_copy(update={"camera": changed}))

    collection, info = collect_views(open_at, board, lambda text: typer.echo(text, err=True), metered=not replay)
    return _Found(collection.frames, collection.views, collection.board, (info.width, info.height))


def _views_in(folder: Path, board: Board) -> _Found:
    views: list[BoardView] = []
    others: Counter[str] = Counter()
    first: tuple[str, int, int] | None = None
    finder, broken = BoardFinder(board), []
    paths = _picture_files(folder)
    with progress("looking for the board", len(paths)) as advance:
        for path in paths:
            try:
                picture = read_grey(path)
            except CalibrationError as error:
                broken.append(str(error))
                continue
            height, width = picture.shape
            first = first or (path.name, width, height)
            if (width, height) != first[1:]:
                raise CalibrationError(
                    f"{path}: is {width} × {height} pixels, {first[0]} is {first[1]} × {first[2]}; "
                    "all must be of one camera at one size"
                )
            view = finder.find(path.name, picture)
            if view is not None:
                views.append(view)
            elif (other := None if views else other_board(picture, board)) is not None:
                others[other] += 1
                if others[other] >= MIN_OTHER_BOARD_PICTURES:  # the search for what is not there takes long
                    break
            advance(1)
    if first is None:
        raise CalibrationError(broken[0])
    for line in broken:
        typer.echo(f"{line}; it is left out", err=True)
    if not views:
        raise CalibrationError(f"{folder}: {_no_board(board, len(paths) - len(broken), others)}")
    if (note := finder.note(board)) is not None:
        typer.echo(note, err=True)
    return _Found(len(paths), views, finder.board, first[1:])


def _no_board(board: Board, pictures: int, others: Counter[str]) -> str:
    wanted = f"no {board.kind} with {board.columns} × {board.rows} inner corners"
    if not others:
        return f"{wanted} in any of {pictures} pictures; --board, --cols and --rows must be those of the board"
    options, times = others.most_common(1)[0]
    return f"{wanted}, but {counted(times, 'picture')} with another board; must be {options}"


def _picture_files(folder: Path) -> list[Path]:
    with raising(f"{folder}: cannot be read", CalibrationError, OSError):
        found = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES]
    paths = sorted(path for path in found if not path.name.startswith("."))  # ._NAME.jpg is what a Mac leaves beside
    if not paths:
        raise CalibrationError(f"{folder}: no pictures in it ({', '.join(sorted(SUFFIXES))})")
    return paths


def _report(result: CameraCalibration) -> None:
    for view in result.used:
        typer.echo(f"{view.name}  {view.rms_px:.2f} px")
    for view in result.dropped:
        typer.echo(f"{view.name}  {view.rms_px:.2f} px  left out: the other views contradict it")
    i = result.intrinsics
    typer.echo(f"{len(result.used)} views used, rms {result.rms_px:.3f} px, lens {i.distortion_model}")
    values = (i.fx, i.fy, i.cx, i.cy, *i.distortion)
    for name, value, sigma in zip(parameters(i), values, result.deviations, strict=True):
        digits, unit = (1, " px") if name[0] in "fc" else (4, "")
        spread = f"± {sigma:.{digits}f}{unit}" if sigma > 0 else "(held: the views show none)"
        typer.echo(f"{name} {value:9.{digits}f} {spread}")
    empty = places_without_corners(corner_counts([view.corners_px for view in result.used], i.width, i.height))
    if empty:
        typer.echo(f"no corner was in the picture's {', '.join(empty)}: how the lens bends there is a guess")


def _write(out: Path, result: CameraCalibration) -> list[str]:
    """Writes camera.yaml and its picture; returns what to say of that."""
    quality: dict[str, Any] = {"calibrated": date.today(), **quality_of(result)}
    before = own_section(out)
    if "shutter" in before:  # what `ledpi calibrate shutter` measured does not change with the lens
        quality["shutter"] = before["shutter"]
    kept = write_keeping_old(out, camera_yaml_text(result.intrinsics, quality))
    lines = [f"{out} written{older(kept)}"]
    picture = picture_beside(out)
    kept = write_keeping_old(picture, cv2.imencode(".png", draw_coverage(result))[1].tobytes())
    return [*lines, f"{picture}: where the corners were{older(kept)}"]


def _name_in_config(settings: Config, file: Path | None, out: Path, size: tuple[int, int]) -> str:
    """Puts the new file into a configuration that names none; returns what to say of that."""
    if file is None:
        return f"no config.yaml was changed; to use it: camera.intrinsics: {out}"
    if settings.camera.intrinsics is not None:
        return f"camera.intrinsics is {settings.camera.intrinsics}"
    wanted = (settings.camera.width, settings.camera.height)
    if size != wanted:
        return f"{file} asks for {wanted[0]} × {wanted[1]} pixels, these have {size[0]} × {size[1]}: not named there"
    return name_in_config(file, ("camera", "intrinsics"), out)
