"""The panel true to scale, from the front and from the back; several pages where one is too small."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ledpi.workshop.panel.body import Body
from ledpi.workshop.panel.circuit import OUTPUTS
from ledpi.workshop.panel.paper import HEIGHT_MM, MARGIN_MM, WIDTH_MM, Page, box

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CLASS_COLOUR = {False: "tab:blue", True: "tab:orange"}  # as the snapshot draws them; True is white
CLASS_FILL = {False: "#d6e4f0", True: "#fff4e0"}
CLASS_LETTER = {False: "B", True: "W"}
READABLE_PT = 6.0  # smaller views leave out what is only to be read
_TILE_MM = (184.0, 236.0)  # of the panel on one page
_TILE_LEFT_MM = (WIDTH_MM - _TILE_MM[0]) / 2
_TILE_FOOT_MM = 28.0  # from the page's foot: the ruler is below
_CROP_MM = 6.0

View = Callable[["Axes", Body, int], None]


def draw_front(axes: Axes, body: Body, marker_id: int) -> None:
    """As the camera sees it: the frame with its opening, the cells, their classes and the classes' pins."""
    draw_front_with(axes, body, marker_id, [OUTPUTS[white] for _, _, white in cell_centres(body)])


def draw_front_with(axes: Axes, body: Body, marker_id: int, pins: Sequence[str]) -> None:
    """The same with a pin for each cell, row by row."""
    draw_frame(axes, body)
    size = text_size(axes, body)
    middle: Any = {"ha": "center", "va": "center"}
    for (x, y, white), pin in zip(cell_centres(body), pins, strict=True):
        draw_cell(axes, body, x, y, white)
        look: Any = {**middle, "color": CLASS_COLOUR[white]}
        axes.text(x, y, CLASS_LETTER[white], fontsize=2.2 * size, weight="bold", **look)
        axes.text(x, y - 0.32 * body.pitch_mm, pin, fontsize=size, **look)
    draw_marks(axes, body, f"TOP, front of ID {marker_id}", mirrored=False)


def draw_back(axes: Axes, body: Body, marker_id: int) -> None:
    """As it is soldered: left and right swapped. LEDs, resistors, one rail for plus and one for each class."""
    draw_frame(axes, body)
    size = text_size(axes, body)
    for x, y, white in cell_centres(body):
        draw_cell(axes, body, -x, y, white)
        look: Any = {"color": CLASS_COLOUR[white], "weight": "bold", "ha": "center", "va": "center"}
        axes.text(-x - 0.42 * body.pitch_mm, y, CLASS_LETTER[white], fontsize=1.5 * size, **look)
        _string(axes, body, -x, y, white)
    _rails(axes, body, size)
    draw_marks(axes, body, f"TOP, back of ID {marker_id}", mirrored=True)


def cell_centres(body: Body) -> Iterator[tuple[float, float, bool]]:
    """The middle of each cell in mm, as seen from the front, and whether it is of the white class."""
    for row in range(body.cells):
        for column in range(body.cells):
            yield *body.cell_centre_mm(row, column), bool(body.codeword[row, column])


def draw_frame(axes: Axes, body: Body) -> None:
    """The body from outside to the lit square."""
    outer, side = body.outer_mm, body.side_mm
    box(axes, -outer / 2, -outer / 2, outer, outer, lw=1.2, facecolor="0.92")
    box(axes, -side / 2, -side / 2, side, side, lw=0.8, facecolor="white")


def draw_cell(axes: Axes, body: Body, x: float, y: float, white: bool) -> None:
    """A cell in its class's colour."""
    half = body.pitch_mm / 2
    box(axes, x - half, y - half, 2 * half, 2 * half, facecolor=CLASS_FILL[white], edgecolor="0.5", lw=0.4)


def _string(axes: Axes, body: Body, x: float, y: float, white: bool) -> None:
    """A cell's LEDs from the plus rail to its resistor, which leads to its class's rail."""
    pitch = body.pitch_mm
    places = [(x + dx, y + dy) for dx, dy in body.led_offsets_mm()]
    plus = (x - 0.4 * pitch, y + _PLUS * pitch)
    end = (x + 0.4 * pitch, y + _RAIL[white] * pitch)
    resistor = (x + 0.4 * pitch, y - 0.2 * pitch)
    path = [plus, *places, (resistor[0], resistor[1] + 0.07 * pitch)]
    axes.plot(*zip(*path, strict=True), color="0.35", lw=0.7, zorder=2)
    draw_flow(axes, path)
    axes.plot([resistor[0], end[0]], [resistor[1] - 0.07 * pitch, end[1]], color="0.35", lw=0.7, zorder=2)
    for px, py in places:
        draw_hole(axes, px, py, body.led_mm)
    draw_resistor(axes, resistor, pitch)
    for dot, colour in ((plus, _PLUS_COLOUR), (end, CLASS_COLOUR[white])):
        axes.plot(*dot, "o", color=colour, ms=2.5, zorder=4)


_PLUS = 0.42  # where the rails run, from the middle of a row of cells, in cells
_RAIL = {False: -0.4, True: -0.45}
_PLUS_COLOUR = "tab:red"


def _rails(axes: Axes, body: Body, size: float) -> None:
    """Along each row of cells; joined at the sides, where they leave for the driver."""
    pitch, half = body.pitch_mm, body.side_mm / 2
    ends = {_PLUS_COLOUR: -half - 2.5, CLASS_COLOUR[False]: half + 2.5, CLASS_COLOUR[True]: half + 5.5}
    heights = {_PLUS_COLOUR: _PLUS, CLASS_COLOUR[False]: _RAIL[False], CLASS_COLOUR[True]: _RAIL[True]}
    for colour, end in ends.items():
        rows = [body.cell_centre_mm(row, 0)[1] + heights[colour] * pitch for row in range(body.cells)]
        for y in rows:
            axes.plot([end, -math.copysign(half - 0.1 * pitch, end)], [y, y], color=colour, lw=1.1, zorder=1.5)
        axes.plot([end, end], [rows[0], rows[-1]], color=colour, lw=1.1)
    if size < READABLE_PT:
        return
    upright: Any = {"rotation": 90, "fontsize": 7, "ha": "center"}
    axes.text(ends[_PLUS_COLOUR] - 2.5, 0, "plus", color=_PLUS_COLOUR, va="center", **upright)
    for white, y, side in ((True, 4, "bottom"), (False, -4, "top")):
        text = f"{CLASS_LETTER[white]}: to the MOSFET of {OUTPUTS[white]}"
        axes.text(half + 7.8, y, text, color=CLASS_COLOUR[white], va=side, **upright)


def draw_resistor(axes: Axes, place: tuple[float, float], pitch: float) -> None:
    """Upright, a tenth of a cell large, its middle at `place`."""
    width, height = 0.07 * pitch, 0.14 * pitch
    x, y = place[0] - width / 2, place[1] - height / 2
    box(axes, x, y, width, height, fill=True, facecolor="white", edgecolor="black", lw=0.7, zorder=3)


def draw_flow(axes: Axes, path: Sequence[tuple[float, float]]) -> None:
    """Arrow heads half-way, the way the current flows: into an LED's anode, out of its cathode."""
    points = np.array(path)
    middle, way = (points[1:] + points[:-1]) / 2, np.diff(points, axis=0)
    way /= np.hypot(*way.T)[:, None]
    look: Any = {"units": "dots", "width": 1, "scale": 0.2, "scale_units": "dots", "headwidth": 3.5, "headlength": 4.5}
    axes.quiver(*middle.T, *way.T, angles="xy", pivot="mid", color="0.35", headaxislength=4.5, minlength=0, **look)


def draw_hole(axes: Axes, x: float, y: float, diameter: float) -> None:
    """A hole for an LED."""
    from matplotlib.patches import Circle

    axes.add_patch(Circle((x, y), diameter / 2, facecolor="white", edgecolor="black", lw=0.7, zorder=3))
    axes.plot(x, y, ".", color="black", ms=1.5, zorder=3)


def draw_marks(axes: Axes, body: Body, text: str, *, mirrored: bool) -> None:
    """The top, and the marker's first corner (top left from the front), which nothing else shows."""
    from matplotlib.patches import Polygon

    half, edge = body.side_mm / 2, body.frame_mm
    top = half + edge / 2
    axes.add_patch(Polygon([(-2.5, top - 2), (2.5, top - 2), (0, top + 2.4)], facecolor="black"))
    axes.text(5, top, text, va="center", fontsize=min(9.0, 0.35 * body.frame_mm * _points_per_mm(axes)))
    corner = half if mirrored else -half
    axes.plot(corner, half, marker="o", color="black", ms=4, zorder=5)


def text_size(axes: Axes, body: Body) -> float:
    """Points, as fits a cell at the scale of these axes."""
    return min(9.0, 0.09 * body.pitch_mm * _points_per_mm(axes))


def _points_per_mm(axes: Axes) -> float:
    """Returns that of the panel, as large as it is shown."""
    left, right = axes.get_xlim()
    return float(axes.get_position().width * WIDTH_MM / (right - left) * 72 / 25.4)


def scaled_view(page: Page, view: View, body: Body, marker_id: int, place: tuple[float, float], size_mm: float) -> None:
    """The whole panel, made smaller, with its lower left corner at `place`."""
    half = body.outer_mm / 2 + 1
    view(page.window(*place, size_mm, size_mm, (-half, half), (-half, half)), body, marker_id)


def true_views(title: str, name: str, view: View, body: Body, marker_id: int) -> list[Page]:
    """The panel at 1 : 1, on as many pages as it takes, each with a ruler."""
    columns, rows = _tiles(body)
    pages = []
    for row in range(rows):
        for column in range(columns):
            tiles = f"; part {_part(row, column)} of {columns} × {rows}" if columns * rows > 1 else ""
            page = Page(title, f"1 : 1{tiles}. {name}")
            _tile(page, view, body, marker_id, row, column, (columns, rows))
            page.ruler(MARGIN_MM + 5, 12)
            pages.append(page)
    return pages


def tile_count(body: Body) -> int:
    """Pages that a view takes at 1 : 1."""
    columns, rows = _tiles(body)
    return columns * rows


def _tiles(body: Body) -> tuple[int, int]:
    return math.ceil(body.outer_mm / _TILE_MM[0]), math.ceil(body.outer_mm / _TILE_MM[1])


def _part(row: int, column: int) -> str:
    return f"{chr(ord('A') + row)}{column + 1}"


def _tile(page: Page, view: View, body: Body, marker_id: int, row: int, column: int, tiles: tuple[int, int]) -> None:
    """One part of the panel. Parts meet at the crop marks, without overlap."""
    width, height = _TILE_MM
    left = -tiles[0] * width / 2 + column * width
    top = tiles[1] * height / 2 - row * height
    axes = page.window(_TILE_LEFT_MM, _TILE_FOOT_MM, width, height, (left, left + width), (top - height, top))
    view(axes, body, marker_id)
    for text in axes.texts:  # which matplotlib would write over the page's edge, and over its title
        text.set_clip_on(True)
        text.set_clip_path(axes.patch)
    if tiles == (1, 1):
        return
    for x in (_TILE_LEFT_MM, _TILE_LEFT_MM + width):
        for y in (_TILE_FOOT_MM, _TILE_FOOT_MM + height):
            out_x, out_y = (-1 if x == _TILE_LEFT_MM else 1), (-1 if y == _TILE_FOOT_MM else 1)
            page.paper.plot([x, x + out_x * _CROP_MM], [y, y], color="black", lw=0.4)
            page.paper.plot([x, x], [y, y + out_y * _CROP_MM], color="black", lw=0.4)
    look: Any = {"fontsize": 6, "ha": "center", "va": "center", "color": "0.3"}
    for there, x, y, part, turn in (
        (column + 1 < tiles[0], _TILE_LEFT_MM + width + 3, HEIGHT_MM / 2, _part(row, column + 1), 90),
        (row + 1 < tiles[1], WIDTH_MM / 2, _TILE_FOOT_MM - 4, _part(row + 1, column), 0),
    ):
        if there:
            page.paper.text(x, y, f"cut along the marks; {part} goes on here", rotation=turn, **look)
