"""The sheet of a panel that hangs on a board's sixteen pins: its views, circuit and parts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ledpi.workshop.panel.body import Body
from ledpi.workshop.panel.circuit import (
    CELL_PINS,
    CHIP_MOST_A,
    CHIP_OWN_A,
    PIN_MOST_A,
    PORTS_MOST_A,
    ROOM_LUX,
    USB_MOST_V,
    PinCircuit,
    ohm_text,
)
from ledpi.workshop.panel.sheet_parts import CRYSTAL, walls
from ledpi.workshop.panel.sheet_views import (
    CLASS_COLOUR,
    READABLE_PT,
    cell_centres,
    draw_cell,
    draw_flow,
    draw_frame,
    draw_front_with,
    draw_hole,
    draw_marks,
    draw_resistor,
    text_size,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_GROUND = -0.42  # where GND runs, from the middle of a row of cells, in cells


def draw_pins_front(axes: Axes, body: Body, marker_id: int) -> None:
    """As the camera sees it, with the pin of each cell."""
    draw_front_with(axes, body, marker_id, CELL_PINS)


def draw_pins_back(axes: Axes, body: Body, marker_id: int) -> None:
    """As it is soldered, left and right swapped: in each cell its pin, a resistor and an LED to GND."""
    draw_frame(axes, body)
    size, pitch = text_size(axes, body), body.pitch_mm
    for (x, y, white), pin in zip(cell_centres(body), CELL_PINS, strict=True):
        draw_cell(axes, body, -x, y, white)
        start, resistor, end = (
            (-x - 0.4 * pitch, y + 0.3 * pitch),
            (-x - 0.4 * pitch, y + 0.1 * pitch),
            -x + 0.4 * pitch,
        )
        path = [start, (resistor[0], y), (-x, y), (end, y), (end, y + _GROUND * pitch)]
        axes.plot(*zip(*path, strict=True), color="0.35", lw=0.7, zorder=2)
        draw_flow(axes, path[1:])
        draw_resistor(axes, resistor, pitch)
        draw_hole(axes, -x, y, body.led_mm)
        axes.plot(*start, "o", color=CLASS_COLOUR[white], ms=2.5, zorder=4)
        axes.plot(end, y + _GROUND * pitch, "o", color="black", ms=2.5, zorder=4)
        axes.text(start[0] + 0.05 * pitch, start[1], pin, fontsize=1.2 * size, color=CLASS_COLOUR[white], va="center")
    _ground_rail(axes, body, size)
    draw_marks(axes, body, f"TOP, back of ID {marker_id}", mirrored=True)


def _ground_rail(axes: Axes, body: Body, size: float) -> None:
    half = body.side_mm / 2
    rows = [body.cell_centre_mm(row, 0)[1] + _GROUND * body.pitch_mm for row in range(body.cells)]
    for y in rows:
        axes.plot([half + 2.5, -half + 0.4 * body.pitch_mm], [y, y], color="black", lw=1.1, zorder=1.5)
    axes.plot([half + 2.5, half + 2.5], [rows[0], rows[-1]], color="black", lw=1.1)
    if size >= READABLE_PT:
        axes.text(half + 5, 0, "to GND", fontsize=7, rotation=90, ha="center", va="center")


def pin_electrics(circuit: PinCircuit, pitch_mm: float) -> list[tuple[str, str]]:
    """Lists what, and how much."""
    ports = ", ".join(f"{name} {1e3 * amperes:.0f} mA" for name, amperes in circuit.ports_most_a().items())
    return [
        ("each cell", f"1 LED, and one resistor of {ohm_text(circuit.resistor_ohm)} (E24), from its own pin to GND"),
        ("current while on", f"{1e3 * circuit.usual_a:.1f} mA, as LEDs of {circuit.forward_v:g} V usually are"),
        (
            "at most",
            f"{1e3 * circuit.most_a:.1f} mA a pin, with {USB_MOST_V:g} V from USB; the chip's pins may give "
            f"{1e3 * PIN_MOST_A:.0f} mA",
        ),
        ("all pins on, at most", f"{ports}; these ports may give {1e3 * PORTS_MOST_A:.0f} mA each"),
        (
            "the chip, at most",
            f"{1e3 * circuit.chip_most_a:.0f} mA, {1e3 * CHIP_OWN_A:.0f} mA of its own; {1e3 * CHIP_MOST_A:.0f} mA may "
            "go in",
        ),
        (
            "light",
            f"about {circuit.luminance(pitch_mm):.0f} cd/m²: in a room of {ROOM_LUX:g} lx "
            f"{100 * circuit.own_share(pitch_mm):.0f} % of the panel's light is its own; dim the room",
        ),
    ]


def pin_parts(body: Body, circuit: PinCircuit) -> list[tuple[str, str, str]]:
    """(pieces, part, what it must be)."""
    count, outer = body.cells**2, f"{body.outer_mm:g} × {body.outer_mm:g} mm"
    return [
        ("1", "Arduino Uno or Nano", CRYSTAL),
        ("1", "USB charger of 5 V", "with a cable for the Arduino; or a computer's USB port"),
        (str(count), f"LED, {body.led_mm:g} mm", f"white, {circuit.forward_v:g} V, wide beam (120°); all of one batch"),
        (str(count), f"resistor {ohm_text(circuit.resistor_ohm)}", "0.125 W, 1 %"),
        (str(count + 1), "jumper wire", "into the Arduino's sockets: one a cell, and GND"),
        ("1", "diffuser", f"white paper of 80 g/m², {outer}"),
        ("1", "frame", f"card, dark, matt, {outer}; opening {body.side_mm:g} × {body.side_mm:g} mm"),
        ("1", "back plate", f"white card, {outer}; holes as on the page “from the back”"),
        *walls(body),
    ]
