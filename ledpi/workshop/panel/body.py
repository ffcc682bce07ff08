"""A panel as a body: its measures, and plates and walls for machines.

The lit square, `side_mm`, is what the decoder's `panels.side_m` means: the frame's opening. Coordinates have their
origin at its middle, x right and y up **as seen from the front**.

The DXF is of release 12, which every program reads: closed polylines and circles, nothing else.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ledpi.core.codewords import Bits
from ledpi.core.errors import ConfigError

FRAME_MM = 10.0  # dark border that sets the lit square off from what is beside it
_WALLS_MM = (3.0, 2.0, 1.5, 1.0, 0.5)  # of boards that are easily had
_WALL_SHARE = 0.06  # of a cell: the decoder leaves out a rim of 0.08
SLOT_PLAY_MM = 0.2
_LEDS_MM = (5.0, 3.0)
_LED_ROOM_MM = 3.0  # around each, for its rim, walls and wires
# An LED that shines as a matt surface does lights a spot at angle θ from below it by cos⁴ θ. 40 % in a cell's corner,
# with white walls to help, is tan θ = 0.76: so far behind the diffuser it must be, over its distance to the corner.
_DEPTH_OVER_REACH = 1.0 / 0.76

_GAP_MM = 5.0  # between two walls on a board
Outline = Sequence[tuple[float, float]]  # of corners; it is closed
Corner = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """A panel's body."""

    codeword: Bits  # (n, n), row 0 at the top; True is class white
    side_mm: float
    leds: int  # in each cell

    def __post_init__(self) -> None:
        if not self.led_mm:
            least_mm = self.cells * _leds_across(self.leds) * (_LEDS_MM[-1] + _LED_ROOM_MM)
            raise ConfigError(
                f"a cell of {self.pitch_mm:.1f} mm has no room for {self.leds} LEDs of {_LEDS_MM[-1]:g} mm; the panel "
                f"must be at least {1e-3 * least_mm:g} m (--side), or have fewer LEDs in a cell (--leds)"
            )

    @property
    def cells(self) -> int:
        """Along a side."""
        return len(self.codeword)

    @property
    def pitch_mm(self) -> float:
        """From the centre of one cell to the next."""
        return self.side_mm / self.cells

    @property
    def outer_mm(self) -> float:
        """The frame's outer edge; diffuser and back plate are as large."""
        return self.side_mm + 2 * FRAME_MM

    @property
    def wall_mm(self) -> float:
        """Thickness of the walls between cells: the thickest board that hides no light that is read."""
        return next((t for t in _WALLS_MM if t <= _WALL_SHARE * self.pitch_mm), _WALLS_MM[-1])

    @property
    def depth_mm(self) -> float:
        """From the LEDs to the diffuser, which is the height of the walls."""
        return float(math.ceil(self.pitch_mm / _leds_across(self.leds) / math.sqrt(2) * _DEPTH_OVER_REACH))

    def cell_centre_mm(self, row: int, column: int) -> tuple[float, float]:
        """Row 0 is at the top, column 0 at the left, from the front."""
        middle = (self.cells - 1) / 2
        return (column - middle) * self.pitch_mm, (middle - row) * self.pitch_mm

    @property
    def led_mm(self) -> float:
        """Diameter of the LEDs that there is room for; 0 where there is none."""
        room_mm = self.pitch_mm / _leds_across(self.leds)
        return next((led for led in _LEDS_MM if room_mm >= led + _LED_ROOM_MM), 0.0)

    def led_offsets_mm(self) -> list[tuple[float, float]]:
        """Returns where a cell's LEDs sit, from its centre, in the order of the string, **as seen from the back**."""
        step = self.pitch_mm / 4
        if self.leds == 3:
            return [(step * math.sin(a), step * math.cos(a)) for a in (0.0, 4 * math.pi / 3, 2 * math.pi / 3)]
        across = _leds_across(self.leds)
        down = math.ceil(self.leds / across)
        places = [
            (((i + 0.5) / across - 0.5) * self.pitch_mm, (0.5 - (j + 0.5) / down) * self.pitch_mm)
            for j in range(down)
            for i in range(across)
        ]
        return places[: self.leds]


def _leds_across(leds: int) -> int:
    return math.ceil(math.sqrt(leds))


def front_dxf(body: Body) -> str:
    """Frame with its opening, which is the lit square; its outer edge is the diffuser's, too."""
    return _dxf("FRONT", [_square(body.outer_mm), _square(body.side_mm)])


def back_dxf(body: Body) -> str:
    """Plate with the LEDs' holes, as seen from behind."""
    holes = []
    for row in range(body.cells):
        for column in range(body.cells):
            x, y = body.cell_centre_mm(row, column)
            holes += [(-x + dx, y + dy) for dx, dy in body.led_offsets_mm()]
    return _dxf("BACK", [_square(body.outer_mm)], holes, body.led_mm / 2)


def walls_dxf(body: Body) -> str:
    """All walls, one above the other: those between cells, slotted from above and from below, then the outer ones."""
    long, high = body.side_mm, body.depth_mm
    slots = [number * body.pitch_mm for number in range(1, body.cells)]
    pieces = [_slotted(long, high, slots, body.wall_mm + SLOT_PLAY_MM)] * len(slots)
    pieces += [[(x, high - y) for x, y in pieces[0]]] * len(slots) if slots else []
    pieces += [_box(long, high)] * 2 + [_box(long + 2 * body.wall_mm, high)] * 2
    placed = [[(x, y + number * (high + _GAP_MM)) for x, y in piece] for number, piece in enumerate(pieces)]
    return _dxf("WALLS", placed)


def walls_stl(body: Body) -> bytes:
    """The walls, inner and outer, as one watertight solid, its lower left corner at the origin."""
    half = body.wall_mm / 2
    edges = [0.0, body.wall_mm]
    for number in range(1, body.cells):
        at = body.wall_mm + number * body.pitch_mm
        edges += [at - half, at + half]
    edges += [body.wall_mm + body.side_mm, 2 * body.wall_mm + body.side_mm]
    strips = len(edges) - 1
    solid = np.zeros((strips + 2, strips + 2), bool)  # with air around
    solid[1:-1:2, 1:-1] = solid[1:-1, 1:-1:2] = True
    triangles: list[Sequence[tuple[float, float, float]]] = []
    for i in range(strips):
        for j in range(strips):
            if solid[i + 1, j + 1]:
                triangles += _block(edges[i : i + 2], edges[j : j + 2], body.depth_mm, solid[i : i + 3, j : j + 3])
    facets = b"".join(struct.pack("<12fH", *_normal(t), *(v for corner in t for v in corner), 0) for t in triangles)
    return b"ledpi panel, walls, mm".ljust(80) + struct.pack("<I", len(triangles)) + facets


def _square(side: float) -> Outline:
    half = side / 2
    return [(-half, -half), (half, -half), (half, half), (-half, half)]


def _box(long: float, high: float) -> Outline:
    return [(0.0, 0.0), (long, 0.0), (long, high), (0.0, high)]


def _slotted(long: float, high: float, slots: Sequence[float], width: float) -> Outline:
    """A wall with slots of half its height from above."""
    top: list[tuple[float, float]] = []
    for at in reversed(slots):
        right, left = at + width / 2, at - width / 2
        top += [(right, high), (right, high / 2), (left, high / 2), (left, high)]
    return [(0.0, 0.0), (long, 0.0), (long, high), *top, (0.0, high)]


def _dxf(
    layer: str, outlines: Sequence[Outline], circles: Sequence[tuple[float, float]] = (), radius: float = 0
) -> str:
    # $INSUNITS 4: millimetres, for those programs that look for it in a file of release 12.
    pairs: list[tuple[int, object]] = [(0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1009")]
    pairs += [(9, "$INSUNITS"), (70, 4), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES")]
    for outline in outlines:
        pairs += [(0, "POLYLINE"), (8, layer), (66, 1), (70, 1)]
        for x, y in outline:
            pairs += [(0, "VERTEX"), (8, layer), (10, f"{x:.4f}"), (20, f"{y:.4f}")]
        pairs += [(0, "SEQEND"), (8, layer)]
    for x, y in circles:
        pairs += [(0, "CIRCLE"), (8, layer), (10, f"{x:.4f}"), (20, f"{y:.4f}"), (40, f"{radius:.4f}")]
    pairs += [(0, "ENDSEC"), (0, "EOF")]
    return "".join(f"{code:>3}\n{value}\n" for code, value in pairs)


def _block(x: Sequence[float], y: Sequence[float], high: float, solid: np.ndarray) -> list[Sequence[Corner]]:
    """Lid, floor, and those sides behind which there is air: `solid` is the 3 × 3 around it."""
    (x0, x1), (y0, y1) = x, y
    quads: list[tuple[Corner, Corner, Corner, Corner]] = [
        ((x0, y0, high), (x1, y0, high), (x1, y1, high), (x0, y1, high)),
        ((x0, y1, 0), (x1, y1, 0), (x1, y0, 0), (x0, y0, 0)),
    ]
    sides = (
        (solid[0, 1], (x0, y1), (x0, y0)),
        (solid[2, 1], (x1, y0), (x1, y1)),
        (solid[1, 0], (x0, y0), (x1, y0)),
        (solid[1, 2], (x1, y1), (x0, y1)),
    )
    quads += [((*a, 0), (*b, 0), (*b, high), (*a, high)) for is_solid, a, b in sides if not is_solid]
    return [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]


def _normal(triangle: Sequence[Corner]) -> tuple[float, float, float]:
    a, b, c = (np.array(corner) for corner in triangle)
    across = np.cross(b - a, c - a)
    x, y, z = (float(value) for value in across / np.linalg.norm(across))
    return x, y, z
