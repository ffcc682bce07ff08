"""`ledpi calibrate board`: a board to print, true to scale."""

from __future__ import annotations

from pathlib import Path

import typer

from ledpi.cli.calibrate import calibrate
from ledpi.core.errors import CalibrationError
from ledpi.core.str_enum import StrEnum


class KindName(StrEnum):
    """The values of --kind."""

    CHESSBOARD = "chessboard"
    CHARUCO = "charuco"


# As `ledpi calibrate camera` looks for it, too: who takes both as they come has one board.
DEFAULT_KIND, DEFAULT_COLS, DEFAULT_ROWS = KindName.CHARUCO, 6, 5


class PaperName(StrEnum):
    """The values of --paper."""

    A4 = "a4"
    LETTER = "letter"


@calibrate.command()
def board(
    out: Path = typer.Argument(Path("board.pdf"), metavar="OUT", help="PDF to write; an older one is kept."),
    kind: KindName = typer.Option(DEFAULT_KIND, help="charuco may be partly out of view."),
    cols: int = typer.Option(DEFAULT_COLS, min=3, max=20, help="Inner corners along the long side."),
    rows: int = typer.Option(DEFAULT_ROWS, min=3, max=20, help="Inner corners along the short side."),
    square_mm: float = typer.Option(30.0, min=1, help="Side of a square."),
    paper: PaperName = typer.Option(PaperName.A4, help="Landscape."),
) -> None:
    """A ChArUco board or chessboard as a PDF, true to scale. Print at 100 %, and glue onto something flat and stiff.

    The ruler below the board is 100 mm long. If it measures anything else on paper, the printer has scaled the page.

    Example: ledpi calibrate board board.pdf --kind chessboard --paper letter
    """
    from ledpi.tools.calibrate.board_sheet import sheet_pdf
    from ledpi.tools.calibrate.boards import Board
    from ledpi.tools.calibrate.files import write_keeping_old

    if out.suffix.lower() != ".pdf":
        raise CalibrationError(f"{out}: must end in .pdf")
    command = f"ledpi calibrate camera --board {kind.value} --cols {cols} --rows {rows}"
    caption = f"100 mm. Squares of {square_mm:g} mm. {command}"
    drawn = sheet_pdf(Board(columns=cols, rows=rows, kind=kind.value), square_mm, paper.value, caption)
    kept = write_keeping_old(out, drawn)
    typer.echo(f"{out} written" + (f"; the older one is kept as {kept}" if kept else ""))
    typer.echo(f"print it at 100 %, check the ruler, then: {command}")
