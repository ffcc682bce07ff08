"""`ledpi calibrate …`: the group, and what its commands share; `calibrate board`: a board to print, true to scale."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Any

import typer

from ledpi.camera.recording.picture import MAX_BYTES, decode_grey
from ledpi.cli import CONFIG, app
from ledpi.config.settings import Config, find_config, load_config
from ledpi.core.errors import CalibrationError
from ledpi.core.files import read_bytes
from ledpi.core.records import Pixels
from ledpi.core.wording import StrEnum
from ledpi.workshop.calibrate.board_sheet import sheet_pdf
from ledpi.workshop.calibrate.boards import Board, Kind
from ledpi.workshop.calibrate.files import Key, change_config, write_keeping_old
from ledpi.workshop.calibrate.status import next_command, parts

calibrate = typer.Typer(rich_markup_mode=None)
app.add_typer(calibrate, name="calibrate")


@calibrate.callback(invoke_without_command=True)
def status(context: typer.Context, config: Path | None = CONFIG) -> None:
    """Measure the camera and the panels. Without a command: what is calibrated, how well, and what comes next.

    Example: ledpi calibrate
    """
    if context.invoked_subcommand is not None:
        return
    settings, file = settings_for(config, [], None)
    typer.echo(
        f"{file}:" if file is not None else "no config.yaml; these are the defaults (ledpi config init writes one)"
    )
    found = list(parts(settings, date.today()))
    for part in found:
        typer.echo(f"  {part.name:8} {part.text}")
    command = next_command(found)
    typer.echo(f"next: {command}" if command is not None else "nothing is missing")


def settings_for(config: Path | None, set_: list[str], recording: Path | None) -> tuple[Config, Path | None]:
    """The configuration, with a recording as its camera if one is given, and the file that it came from."""
    file = find_config(config)
    overrides = list(set_)
    if recording is not None:
        overrides.append(f"camera.source=recording:{recording}")
    own_size = ("panels.side_m=1",)  # it has no part in what is measured here
    return load_config(file, tuple(overrides), without_file=own_size), file


def name_in_config(file: Path, key: tuple[str, ...], written: Path) -> str:
    """Puts the name of a file that was written into the configuration; what to say of that."""
    beside = written.resolve().parent == file.resolve().parent  # paths in the file are relative to it
    place = written.name if beside else str(written.resolve())
    return change(file, {key: place}, f"{'.'.join(key)}: {place}")


def change(file: Path, changes: Mapping[Key, Any], what: str) -> str:
    """Changes keys of a file; what to say of that."""
    return f"{file}: {what} written; the older one is kept as {change_config(file, changes)}"


def older(kept: Path | None) -> str:
    """Says where the file is that was there before."""
    return f"; the older one is kept as {kept}" if kept else ""


def read_grey(path: Path) -> Pixels:
    """A picture file as grey values (H, W). Raises CalibrationError where it is none."""
    picture = decode_grey(read_bytes(path, CalibrationError, MAX_BYTES))
    if picture is None:
        raise CalibrationError(f"{path}: is not a picture that can be decoded")
    return picture


# As `ledpi calibrate camera` looks for it, too: who takes both as they come has one board.
DEFAULT_KIND, DEFAULT_COLS, DEFAULT_ROWS = Kind.CHARUCO, 6, 5


class PaperName(StrEnum):
    """The values of --paper."""

    A4 = "a4"
    LETTER = "letter"


@calibrate.command()
def board(
    out: Path = typer.Argument(Path("board.pdf"), metavar="OUT", help="PDF to write; an older one is kept."),
    kind: Kind = typer.Option(DEFAULT_KIND, help="charuco may be partly out of view."),
    cols: int = typer.Option(DEFAULT_COLS, min=3, max=20, help="Inner corners along the long side."),
    rows: int = typer.Option(DEFAULT_ROWS, min=3, max=20, help="Inner corners along the short side."),
    square_mm: float = typer.Option(30.0, min=1, help="Side of a square."),
    paper: PaperName = typer.Option(PaperName.A4, help="Landscape."),
) -> None:
    """A ChArUco board or chessboard as a PDF, true to scale. Print at 100 %, and glue onto something flat and stiff.

    The ruler below the board is 100 mm long. If it measures anything else on paper, the printer has scaled the page.

    Example: ledpi calibrate board board.pdf --kind chessboard --paper letter
    """
    if out.suffix.lower() != ".pdf":
        raise CalibrationError(f"{out}: must end in .pdf")
    command = f"ledpi calibrate camera --board {kind} --cols {cols} --rows {rows}"
    caption = f"100 mm. Squares of {square_mm:g} mm. {command}"
    drawn = sheet_pdf(Board(columns=cols, rows=rows, kind=kind), square_mm, paper.value, caption)
    kept = write_keeping_old(out, drawn)
    typer.echo(f"{out} written{older(kept)}")
    typer.echo(f"print it at 100 %, check the ruler, then: {command}")
