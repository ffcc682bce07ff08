"""`ledpi calibrate camera`: chessboard pictures → camera.yaml."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ledpi.cli.calibrate import calibrate
from ledpi.cli.progress import progress
from ledpi.errors import CalibrationError

if TYPE_CHECKING:
    from ledpi.calibrate.camera import Board, BoardView, CameraCalibration
    from ledpi.records import Pixels

SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".tif", ".tiff"}

@calibrate.command()
def camera(
    folder: Path = typer.Argument(help="Folder with the pictures."),
    cols: int = typer.Option(6, min=3, help="Inner corners along the board's one side."),
    rows: int = typer.Option(5, min=3, help="Inner corners along the other."),
    out: Path = typer.Option(Path("camera.yaml"), help="File to write; an older one is kept as NAME.bak-1."),
) -> None:
    """Chessboard pictures → camera.yaml (ROS camera_info form). The squares' size does not matter.

    Take 15 or more with the very camera, at the width and height that config.yaml asks for: the board
    flat and at rest, all over the field of view, tilted by 20° to 40° to different sides. Views that
    contradict the others are named and left out.

    Example: ledpi calibrate camera pictures --cols 9 --rows 6
    """
    from ledpi.calibrate.camera import Board, calibrate_camera
    from ledpi.calibrate.files import write_keeping_old
    from ledpi.camera_yaml import camera_yaml_text

    paths = _picture_files(folder)
    board = Board(columns=cols, rows=rows)
    views, (width, height) = _find_boards(paths, board)
    if not views:
        raise CalibrationError(
            f"{folder}: no board with {cols} × {rows} inner corners in any of {len(paths)} pictures; "
            "--cols and --rows must be those of the board"
        )
    try:
        result = calibrate_camera(views, board, width, height)
    except CalibrationError as error:
        raise CalibrationError(f"{folder}: {error}") from None
    quality = {
        "rms_px": round(result.rms_px, 4),
        "fx_sigma_px": round(result.focal_sigma_px, 3),
        "views": len(result.used),
    }
    kept = write_keeping_old(out, camera_yaml_text(result.intrinsics, quality))
    _report(result, len(paths))
    typer.echo(f"{out} written" + (f"; the older one is kept as {kept}" if kept else ""))


def _picture_files(folder: Path) -> list[Path]:
    try:
        paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    except OSError as error:
        raise CalibrationError(f"{folder}: cannot be read: {error.strerror}") from None
    if not paths:
        raise CalibrationError(f"{folder}: no pictures in it ({', '.join(sorted(SUFFIXES))})")
    return paths


def _read_grey(path: Path) -> Pixels:
    import cv2
    import numpy as np

    # The file's own orientation mark is passed over: the lens belongs to the sensor's rows and columns.
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        data = np.frombuffer(path.read_bytes(), np.uint8)
        picture = cv2.imdecode(data, flags) if data.size else None
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror}") from None
    if picture is None:
        raise CalibrationError(f"{path}: is not a picture that can be decoded; remove it from the folder")
    return np.asarray(picture, dtype=np.uint8)


def _find_boards(paths: list[Path], board: Board) -> tuple[list[BoardView], tuple[int, int]]:
    """The views with a board, and the (width, height) that all pictures share."""
    from ledpi.calibrate.camera import BoardView, find_board

    views: list[BoardView] = []
    size = (0, 0)
    with progress("looking for the board", len(paths)) as advance:
        for path in paths:
            picture = _read_grey(path)
            height, width = picture.shape
            if path == paths[0]:
                size = (width, height)
            if (width, height) != size:
                raise CalibrationError(
                    f"{path}: is {width} × {height} pixels, {paths[0].name} is {size[0]} × {size[1]}; "
                    "all must be of one camera at one size"
                )
            corners = find_board(picture, board)
            if corners is not None:
                views.append(BoardView(name=path.name, corners_px=corners))
            advance(1)
    return views, size


def _report(result: CameraCalibration, pictures: int) -> None:
    for view in result.used:
        typer.echo(f"{view.name}  {view.rms_px:.2f} px")
    for view in result.dropped:
        typer.echo(f"{view.name}  {view.rms_px:.2f} px  left out: the other views contradict it")
    i = result.intrinsics
    found = len(result.used) + len(result.dropped)
    typer.echo(f"{pictures} pictures, {found} with the board, {len(result.used)} used")
    typer.echo(f"rms {result.rms_px:.3f} px")
    typer.echo(f"fx {i.fx:.1f} ± {result.focal_sigma_px:.1f}, fy {i.fy:.1f}, cx {i.cx:.1f}, cy {i.cy:.1f} px")
    typer.echo("k1 {:.4f}, k2 {:.4f}, p1 {:.4f}, p2 {:.4f}, k3 {:.4f}".format(*i.distortion))
