"""The driver's schematic: Arduino, two MOSFETs, and the cells of both classes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ledpi.tools.panel.circuit import Circuit, ohm_text
from ledpi.tools.panel.firmware import OUTPUTS
from ledpi.tools.panel.paper import box
from ledpi.tools.panel.sheet_views import CLASS_COLOUR

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GATE_OHM, PULL_DOWN_OHM = 220.0, 10_000.0
SIZE_MM = (180.0, 112.0)
_LW = 0.9


def draw_schematic(axes: Axes, circuit: Circuit, frequencies_hz: tuple[float, float]) -> None:
    """On an area of SIZE_MM, in millimetres."""
    plus_y, ground_y = 104.0, 8.0
    draw_wire(axes, (14, plus_y), (156, plus_y))
    draw_wire(axes, (14, ground_y), (148, ground_y))
    _supply(axes, circuit, plus_y, ground_y)
    _arduino(axes, ground_y)
    for white, x in ((False, 92.0), (True, 148.0)):
        _class(axes, circuit, white, frequencies_hz[white], x, plus_y, ground_y)


def _supply(axes: Axes, circuit: Circuit, plus_y: float, ground_y: float) -> None:
    x = 14.0
    draw_wire(axes, (x, plus_y), (x, 96))
    box(axes, x - 1.5, 88, 3, 8)
    draw_wire(axes, (x, 96), (x, 88), (x, 63))
    axes.text(x + 3, 92, f"fuse\n{circuit.supply_rating_a:g} A", fontsize=7, va="center")
    axes.plot([x - 4, x + 4], [63, 63], color="black", lw=_LW)
    axes.plot([x - 2, x + 2], [60.5, 60.5], color="black", lw=2)
    draw_wire(axes, (x, 60.5), (x, ground_y))
    axes.text(x + 3, 73, f"{circuit.supply_v:g} V\n{circuit.supply_rating_a:g} A", fontsize=8, va="center")
    c = 34.0
    draw_wire(axes, (c, plus_y), (c, 84))
    axes.plot([c - 3, c + 3], [84, 84], color="black", lw=1.4)
    axes.plot([c - 3, c + 3], [82, 82], color="black", lw=1.4)
    draw_wire(axes, (c, 82), (c, 76))
    draw_ground(axes, c, 76)
    axes.text(c + 4, 83, f"100 µF\n{_capacitor_v(circuit.supply_v)} V", fontsize=7, va="center")
    _dot(axes, c, plus_y)


def _capacitor_v(supply_v: float) -> int:
    return next(v for v in (10, 16, 25, 35, 50, 63) if v >= 1.25 * supply_v)


def _arduino(axes: Axes, ground_y: float) -> None:
    box(axes, 26, 16, 26, 48, lw=1.2)
    axes.text(39, 54, "Arduino\nUno or Nano\n(ATmega328P,\n5 V, 16 MHz)", fontsize=7, ha="center", va="center")
    axes.text(27, 42, "USB: 5 V", fontsize=7)
    for white, y in _PIN_Y.items():
        axes.text(51, y, OUTPUTS[white], fontsize=8, ha="right", va="center", weight="bold", color=CLASS_COLOUR[white])
    axes.text(39, 18, "GND", fontsize=8, ha="center")
    draw_wire(axes, (39, 16), (39, ground_y))
    _dot(axes, 39, ground_y)


_PIN_Y = {False: 28.0, True: 36.0}


def _class(axes: Axes, circuit: Circuit, white: bool, hz: float, x: float, plus_y: float, ground_y: float) -> None:
    """One class: two of its cells, its MOSFET, and the way from the Arduino's pin to the gate."""
    colour, name, count = CLASS_COLOUR[white], "white" if white else "black", circuit.cells[white]
    bus_y, gate_y, pin_y = 52.0, 24.0, _PIN_Y[white]
    for cell_x in (x - 8, x + 8):
        _cell(axes, circuit, cell_x, plus_y, bus_y)
    axes.text(x, 80, "…", fontsize=14, ha="center", va="center")
    draw_wire(axes, (x - 8, bus_y), (x + 8, bus_y), colour=colour)
    axes.text(x + 16, 84, f"{count} cells\nof class\n{name}", fontsize=7.5, va="center", color=colour)
    draw_wire(axes, (x, bus_y), (x, gate_y + 8), colour=colour)
    _dot(axes, x, bus_y, colour)
    axes.text(x + 2, 44, f"{1e3 * circuit.class_a[white]:.0f} mA\n{hz:g} Hz", fontsize=7, va="center", color=colour)
    _mosfet(axes, x, gate_y)
    draw_wire(axes, (x, gate_y - 4), (x, ground_y))
    _dot(axes, x, ground_y)
    gate_x = x - 6
    start = gate_x - 22
    draw_wire(axes, (52, pin_y), (start, pin_y), (start, gate_y), (start + 3, gate_y), colour=colour)
    box(axes, start + 3, gate_y - 1.5, 9, 3)
    axes.text(start + 7.5, gate_y + 2.6, ohm_text(GATE_OHM), fontsize=7, ha="center")
    draw_wire(axes, (start + 12, gate_y), (gate_x, gate_y))
    down = start + 15.5
    _dot(axes, down, gate_y)
    draw_wire(axes, (down, gate_y), (down, 20))
    box(axes, down - 1.5, 12, 3, 8)
    axes.text(down - 2.5, 16, ohm_text(PULL_DOWN_OHM), fontsize=7, ha="right", va="center")
    draw_wire(axes, (down, 12), (down, ground_y))
    _dot(axes, down, ground_y)


def _cell(axes: Axes, circuit: Circuit, x: float, plus_y: float, bus_y: float) -> None:
    """A string: the LEDs, at most three of them drawn, and the resistor."""
    _dot(axes, x, plus_y)
    drawn = min(circuit.leds, 3)
    y = plus_y
    for number in range(drawn):
        top = plus_y - 6 - 10 * number
        draw_wire(axes, (x, y), (x, top))
        draw_led(axes, x, top)
        y = top - 4.5
    if circuit.leds > drawn:
        axes.text(x - 2, y - 1, f"⋮ {circuit.leds} in all", fontsize=6, ha="right", va="center")
    resistor_top = bus_y + 14
    draw_wire(axes, (x, y), (x, resistor_top))
    box(axes, x - 1.5, resistor_top - 8, 3, 8)
    axes.text(x - 2.2, resistor_top - 4, ohm_text(circuit.resistor_ohm), fontsize=6.5, ha="right", va="center")
    draw_wire(axes, (x, resistor_top - 8), (x, bus_y))


def draw_led(axes: Axes, x: float, top: float) -> None:
    """Anode above; 4.5 mm high."""
    from matplotlib.patches import Polygon

    triangle = [(x - 2.2, top), (x + 2.2, top), (x, top - 4.5)]
    axes.add_patch(Polygon(triangle, facecolor="white", edgecolor="black", lw=_LW))
    axes.plot([x - 2.2, x + 2.2], [top - 4.5, top - 4.5], color="black", lw=_LW)
    for shift in (0.0, 1.8):
        axes.annotate(
            "",
            (x + 5.2, top - 0.2 - shift),
            (x + 3.0, top - 2.4 - shift),
            arrowprops={"arrowstyle": "->", "lw": 0.6, "mutation_scale": 4},
        )


def _mosfet(axes: Axes, x: float, gate_y: float) -> None:
    """N-channel: gate at the left at (x − 6, gate_y), drain above, source below."""
    axes.plot([x - 6, x - 4.6], [gate_y, gate_y], color="black", lw=_LW)
    axes.plot([x - 4.6, x - 4.6], [gate_y - 3.4, gate_y + 3.4], color="black", lw=1.4)
    for y in (-3, 0, 3):
        axes.plot([x - 3.6, x - 3.6], [gate_y + y - 1, gate_y + y + 1], color="black", lw=1.4)
    draw_wire(axes, (x - 3.6, gate_y + 3), (x, gate_y + 3), (x, gate_y + 8))
    draw_wire(axes, (x - 3.6, gate_y - 3), (x, gate_y - 3), (x, gate_y - 4))
    draw_wire(axes, (x, gate_y), (x, gate_y - 3))
    look = {"arrowstyle": "-|>", "lw": _LW, "mutation_scale": 6, "color": "black", "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (x - 3.6, gate_y), (x, gate_y), arrowprops=look)
    axes.text(x + 1.5, gate_y + 4.5, "D", fontsize=6)
    axes.text(x + 1.5, gate_y - 5.5, "S", fontsize=6)
    axes.text(x - 7, gate_y + 3, "G", fontsize=6)


def draw_ground(axes: Axes, x: float, y: float) -> None:
    """The sign for GND, its upper end at (x, y)."""
    for number, half in enumerate((3.0, 2.0, 1.0)):
        axes.plot([x - half, x + half], [y - 1.2 * number, y - 1.2 * number], color="black", lw=_LW)


def draw_wire(axes: Axes, *points: tuple[float, float], colour: str = "black") -> None:
    """A wire from point to point."""
    axes.plot(*zip(*points, strict=True), color=colour, lw=_LW, solid_joinstyle="miter", zorder=1)


def _dot(axes: Axes, x: float, y: float, colour: str = "black") -> None:
    axes.plot(x, y, "o", color=colour, ms=3)
