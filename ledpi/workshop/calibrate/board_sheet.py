"""A board as a PDF of one page, true to scale, with a ruler to check the printer by."""

from __future__ import annotations

from io import BytesIO

import numpy as np

from ledpi.core.codewords import Bits
from ledpi.core.errors import CalibrationError, install_command
from ledpi.workshop.calibrate.boards import TEXELS, Board

MM_PER_INCH = 25.4
PAPERS_MM = {"a4": (297.0, 210.0), "letter": (279.4, 215.9)}  # landscape
MARGIN_MM = 8.0  # that no printer reaches, and white that the board's outer squares need
FOOT_MM = 12.0  # below the board, for the ruler and the text
RULER_MM = 100.0

Rectangle = tuple[int, int, int, int]  # x, y, width, height, in texels from the top left


def check_fit(board: Board, square_mm: float, paper: str) -> None:
    """Raises CalibrationError where the board does not fit on the paper, with the largest square that would."""
    width, height = PAPERS_MM[paper]
    largest = min((width - 2 * MARGIN_MM) / (board.columns + 1), (height - MARGIN_MM - FOOT_MM) / (board.rows + 1))
    if square_mm > largest:
        raise CalibrationError(
            f"{board.columns} × {board.rows} inner corners with squares of {square_mm:g} mm do not fit on {paper}: "
            f"squares must be at most {np.floor(largest * 10) / 10:g} mm, or fewer"
        )


def sheet_pdf(board: Board, square_mm: float, paper: str, caption: str) -> bytes:
    """The board as a PDF, in vectors. Raises CalibrationError where it does not fit, or matplotlib is missing."""
    try:
        from matplotlib.collections import PatchCollection
        from matplotlib.figure import Figure
        from matplotlib.patches import Rectangle as Patch
    except ImportError:
        raise CalibrationError(f"matplotlib is not installed: {install_command('calibrate')}") from None
    check_fit(board, square_mm, paper)
    width, height = PAPERS_MM[paper]
    figure = Figure(figsize=(width / MM_PER_INCH, height / MM_PER_INCH))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))  # in mm from the sheet's top left
    axes.set(xlim=(0, width), ylim=(height, 0))
    axes.axis("off")
    left = (width - (board.columns + 1) * square_mm) / 2
    top = MARGIN_MM + (height - MARGIN_MM - FOOT_MM - (board.rows + 1) * square_mm) / 2
    mm = square_mm / TEXELS
    patches = [Patch((left + x * mm, top + y * mm), w * mm, h * mm) for x, y, w, h in rectangles(board.black())]
    axes.add_collection(PatchCollection(patches, facecolor="black", linewidth=0))
    y = height - FOOT_MM / 2
    axes.plot([MARGIN_MM, MARGIN_MM + RULER_MM], [y, y], color="black", linewidth=0.5, solid_capstyle="butt")
    for x in np.linspace(MARGIN_MM, MARGIN_MM + RULER_MM, 11):
        axes.plot([x, x], [y - 1.5, y + 1.5], color="black", linewidth=0.5, solid_capstyle="butt")
    axes.text(MARGIN_MM + RULER_MM + 4, y, caption, fontsize=8, verticalalignment="center")
    drawn = BytesIO()
    figure.savefig(drawn, format="pdf")
    return drawn.getvalue()


def rectangles(black: Bits) -> list[Rectangle]:
    """Rectangles that together cover what is black, each as high as the same run of texels goes on."""
    found: list[Rectangle] = []
    begun: dict[tuple[int, int], int] = {}  # run → the row in which it began
    for row, texels in enumerate([*black, np.zeros(black.shape[1], bool)]):
        edges = np.flatnonzero(np.diff(texels.astype(np.int8), prepend=0, append=0))
        runs = {(int(a), int(b)) for a, b in edges.reshape(-1, 2)}
        for a, b in sorted(set(begun) - runs):
            first = begun.pop((a, b))
            found.append((a, first, b - a, row - first))
        for run in runs - set(begun):
            begun[run] = row
    return found
