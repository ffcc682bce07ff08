"""The panel's body in millimetres: cells, walls, diffuser, frame, and where the LEDs sit. Pure arithmetic.

The lit square, `side_mm`, is what the decoder's `panels.side_m` means: the frame's opening. Coordinates have their
origin at its middle, x right and y up **as seen from the front**.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ledpi.core.errors import ConfigError
from ledpi.markers.codewords import Bits

_FRAME_MM = 10.0  # dark border that sets the lit square off from what is beside it
_WALLS_MM = (3.0, 2.0, 1.5, 1.0, 0.5)  # of boards that are easily had
_WALL_SHARE = 0.06  # of a cell: the decoder leaves out a rim of 0.08
SLOT_PLAY_MM = 0.2
_LEDS_MM = (5.0, 3.0)
_LED_ROOM_MM = 3.0  # around each, for its rim, walls and wires
# An LED that shines as a matt surface does lights a spot at angle θ from below it by cos⁴ θ. 40 % in a cell's corner,
# with white walls to help, is tan θ = 0.76: so far behind the diffuser it must be, over its distance to the corner.
_DEPTH_OVER_REACH = 1.0 / 0.76


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
        return self.side_mm + 2 * _FRAME_MM

    @property
    def frame_mm(self) -> float:
        """Width of the frame around the lit square."""
        return _FRAME_MM

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
        """Diameter of the LEDs that there is room for."""
        return _led_mm(self.pitch_mm, self.leds)

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


def _led_mm(pitch_mm: float, leds: int) -> float:
    """0 where there is no room."""
    return next((led for led in _LEDS_MM if pitch_mm / _leds_across(leds) >= led + _LED_ROOM_MM), 0.0)
