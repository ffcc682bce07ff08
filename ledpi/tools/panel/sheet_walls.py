"""The walls between the cells, and a section through the panel, with their measures."""

from __future__ import annotations

import math

from ledpi.tools.panel.body import SLOT_PLAY_MM, Body
from ledpi.tools.panel.paper import MARGIN_MM, Page, box

_LEFT = MARGIN_MM + 20
_MAX_WIDTH_MM, _MAX_HEIGHT_MM = 120.0, 30.0  # that a wall is drawn
_CELL = 40.0  # of the section


def draw_wall(page: Page, body: Body, y: float) -> None:
    """One of them with its slots; `y` is the page's height of its lower edge."""
    long = min(_MAX_WIDTH_MM, body.side_mm)
    scale = long / body.side_mm
    high = min(_MAX_HEIGHT_MM, scale * body.depth_mm)
    box(page.paper, _LEFT, y, long, high)
    slot = max(0.8, scale * (body.wall_mm + SLOT_PLAY_MM))
    for number in range(1, body.cells):
        at = _LEFT + number * scale * body.pitch_mm
        box(page.paper, at - slot / 2, y + high / 2, slot, high / 2, facecolor="0.85")
    _dimension(page, (_LEFT, y - 4), (_LEFT + long, y - 4), f"{body.side_mm:g}")
    _dimension(page, (_LEFT - 6, y), (_LEFT - 6, y + high), f"{body.depth_mm:g}")
    if body.cells > 1:
        _dimension(page, (_LEFT, y + high + 3), (_LEFT + scale * body.pitch_mm, y + high + 3), f"{body.pitch_mm:.4g}")
    half = body.cells - 1
    text = (
        f"{2 * half} pieces, {body.wall_mm:g} mm thick\n"
        f"slots {body.wall_mm + SLOT_PLAY_MM:.1f} × {body.depth_mm / 2:g} mm\n"
        f"{half} slotted from above,\n{half} from below"
    )
    page.paper.text(_LEFT + long + 4, y + high / 2, text, fontsize=7, va="center")


def draw_section(page: Page, body: Body, y: float) -> None:
    """Back plate, walls, diffuser and frame from the side, as if there were two cells."""
    deep = min(_MAX_HEIGHT_MM, _CELL * body.depth_mm / body.pitch_mm)
    layers = (
        ("back plate with the LEDs", -3.0, 3.0, "0.75"),
        ("diffuser", deep, 3.0, "#dcebfa"),
        ("frame", deep + 3.0, 2.5, "0.3"),
    )
    for name, bottom, thick, colour in layers:
        box(page.paper, _LEFT - 6, y + bottom, 2 * _CELL + 12, thick, facecolor=colour, lw=0.6)
        page.paper.text(_LEFT + 2 * _CELL + 9, y + bottom + thick / 2, name, fontsize=7, va="center")
    box(page.paper, _LEFT, y + deep + 3.0, 2 * _CELL, 2.5, facecolor="white", lw=0.6)
    wall = _CELL * body.wall_mm / body.pitch_mm
    for at in (-wall, _CELL - wall / 2, 2 * _CELL):  # the outer ones stand outside the lit square
        box(page.paper, _LEFT + at, y, wall, deep, facecolor="0.9", lw=0.6)
    across = math.ceil(math.sqrt(body.leds))
    for led in range(2 * across):
        box(page.paper, _LEFT + (led + 0.5) / across * _CELL - 1.2, y, 2.4, 2.6, facecolor="#ffe9a8", lw=0.6)
    _dimension(page, (_LEFT - 10, y), (_LEFT - 10, y + deep), f"{body.depth_mm:g}")
    opening = f"opening of the frame = lit square: {body.side_mm:g} ({body.cells} cells)"
    _dimension(page, (_LEFT, y + deep + 8), (_LEFT + 2 * _CELL, y + deep + 8), opening)


def _dimension(page: Page, start: tuple[float, float], end: tuple[float, float], text: str) -> None:
    """A dimension line with its measure in millimetres."""
    page.paper.annotate("", end, start, arrowprops={"arrowstyle": "<->", "lw": 0.6, "shrinkA": 0, "shrinkB": 0})
    x, y = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    if start[0] == end[0]:
        page.paper.text(x - 2.2, y, text, fontsize=7, ha="right", va="center")
    else:
        page.paper.text(x, y + 0.8, text, fontsize=7, ha="center", va="bottom")
