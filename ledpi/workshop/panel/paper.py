"""A4 pages that are drawn in millimetres, as PDF and as SVG. Needs matplotlib, the extra `panel`."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
from matplotlib.backends.backend_pdf import FigureCanvasPdf, PdfPages
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH_MM, HEIGHT_MM = 210.0, 297.0
MARGIN_MM = 15.0
RULER_MM = 100.0
_MM_PER_INCH = 25.4
_LINE_MM = 3.6  # of a table
# Text as text, so that it can be searched; no date, so that the same panel gives the same file.
_STYLE: Any = {"pdf.fonttype": 42, "svg.hashsalt": "ledpi", "font.family": "DejaVu Sans", "font.size": 8}


class Page:
    """One page; `paper` covers it all, in millimetres from the lower left corner."""

    def __init__(self, title: str, subtitle: str) -> None:
        self.figure = Figure(figsize=(WIDTH_MM / _MM_PER_INCH, HEIGHT_MM / _MM_PER_INCH))
        self.paper = self.window(0, 0, WIDTH_MM, HEIGHT_MM, (0, WIDTH_MM), (0, HEIGHT_MM))
        self.paper.text(MARGIN_MM, HEIGHT_MM - 13, title, fontsize=14, weight="bold")
        self.paper.text(MARGIN_MM, HEIGHT_MM - 19, subtitle, fontsize=8, color="0.3")

    def window(
        self, x: float, y: float, width: float, height: float, across: tuple[float, float], up: tuple[float, float]
    ) -> Axes:
        """An area of the page (mm) that shows these coordinates, and nothing outside of them."""
        area = (x / WIDTH_MM, y / HEIGHT_MM, width / WIDTH_MM, height / HEIGHT_MM)
        axes = self.figure.add_axes(area, frameon=False)
        axes.set_xlim(*across)
        axes.set_ylim(*up)
        axes.set_axis_off()
        return axes

    def ruler(self, x: float, y: float) -> None:
        """100 mm, so that a print can be checked."""
        self.paper.plot([x, x + RULER_MM], [y, y], color="black", lw=0.8, gid="ruler", solid_capstyle="butt")
        for mm in range(0, int(RULER_MM) + 1, 5):
            self.paper.plot([x + mm, x + mm], [y, y + (3 if mm % 10 == 0 else 1.8)], color="black", lw=0.5)
        for mm in range(0, int(RULER_MM) + 1, 20):
            self.paper.text(x + mm, y + 3.6, str(mm), fontsize=6, ha="center")
        note = "mm. Print at 100 %, not “fit to page”;\nthis ruler must measure 100 mm."
        self.paper.text(x + RULER_MM + 4, y, note, fontsize=7)

    def table(self, x: float, y: float, widths: Sequence[float], rows: Sequence[Sequence[str]]) -> float:
        """Rows of text from (x, y) downward; where the table ends."""
        for row in rows:
            left, lines = x, max(cell.count("\n") + 1 for cell in row)
            for text, width in zip(row, widths, strict=True):
                self.paper.text(left, y - 1.0, text, fontsize=7.5, va="top", linespacing=1.25)
                left += width
            y -= lines * _LINE_MM + 1.2
            self.paper.plot([x, x + sum(widths)], [y, y], color="0.75", lw=0.5)
        return y


def write_pdf(pages: Sequence[Page], path: Path) -> None:
    """All pages in one file."""
    drawn = BytesIO()  # first in memory, as matplotlib itself stumbles over a disk that is full
    with matplotlib.rc_context(_STYLE), PdfPages(drawn, metadata={"CreationDate": None}) as pdf:
        for page in pages:
            FigureCanvasPdf(page.figure)
            pdf.savefig(page.figure)
    path.write_bytes(drawn.getvalue())


def write_svg(page: Page, path: Path) -> None:
    """One page."""
    with matplotlib.rc_context(_STYLE):
        FigureCanvasSVG(page.figure)
        page.figure.savefig(path, metadata={"Date": None})


def box(axes: Axes, x: float, y: float, width: float, height: float, **look: Any) -> None:
    """A rectangle from its lower left corner."""
    axes.add_patch(Rectangle((x, y), width, height, **{"facecolor": "none", "edgecolor": "black", "lw": 0.8, **look}))
