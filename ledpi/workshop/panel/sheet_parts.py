"""Parts to buy for a panel and its electrics, as rows of text; its walls, its section, and a board's pins, drawn."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ledpi.workshop.panel.body import SLOT_PLAY_MM, Body
from ledpi.workshop.panel.circuit import (
    CELL_PINS,
    CHIP_MOST_A,
    CHIP_OWN_A,
    PIN_MOST_A,
    PORTS_MOST_A,
    ROOM_LUX,
    USB_MOST_V,
    Circuit,
    PinCircuit,
    ohm_text,
)
from ledpi.workshop.panel.paper import MARGIN_MM, Page, box
from ledpi.workshop.panel.schematic import GATE_OHM, PULL_DOWN_OHM
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


_MOSFETS = ((30, "AO3400A (SMD) or FQP30N06L (TO-220)"), (60, "FQP30N06L (TO-220)"), (100, "IRL520N (TO-220)"))
CRYSTAL = "ATmega328P, 5 V, 16 MHz; with a crystal, not a resonator"
_SPREAD_V = 0.1  # of LEDs of one batch

_LEFT = MARGIN_MM + 20
_MAX_WIDTH_MM, _MAX_HEIGHT_MM = 120.0, 30.0  # that a wall is drawn
_CELL = 40.0  # of the section


def electrics(circuit: Circuit) -> list[tuple[str, str]]:
    """Lists what, and how much."""
    spread_v = _SPREAD_V * circuit.leds
    low_ma, high_ma = (1e3 * (circuit.headroom_v + off_v) / circuit.resistor_ohm for off_v in (-spread_v, spread_v))
    black_ma, white_ma = (1e3 * amperes for amperes in circuit.class_a)
    series = "LEDs in series" if circuit.leds > 1 else "LED"
    return [
        ("each cell", f"{circuit.leds} {series}, and one resistor of {ohm_text(circuit.resistor_ohm)} (E24)"),
        (
            "left for the resistor",
            f"{circuit.supply_v:g} V − {circuit.leds} × {circuit.forward_v:g} V = {circuit.headroom_v:.2f} V",
        ),
        (
            "current while on",
            f"{1e3 * circuit.cell_a:.1f} mA; {low_ma:.1f} to {high_ma:.1f} mA as LEDs differ by ± {_SPREAD_V:g} V",
        ),
        ("resistor", f"{1e3 * circuit.resistor_w:.0f} mW while on; take one for {circuit.resistor_rating_w:g} W"),
        (
            "through the MOSFETs",
            f"black {black_ma:.0f} mA ({circuit.cells[0]} cells), white {white_ma:.0f} mA ({circuit.cells[1]} cells)",
        ),
        ("whole panel", f"{circuit.panel_w:.1f} W on average; each class is on for half of the time"),
    ]


def parts(body: Body, circuit: Circuit) -> list[tuple[str, str, str]]:
    """(pieces, part, what it must be)."""
    outer = f"{body.outer_mm:g} × {body.outer_mm:g} mm"
    return [
        *_electric_parts(body, circuit),
        ("1", "diffuser", f"opal acrylic, 2 to 3 mm, {outer}"),
        ("1", "frame", f"opaque, dark, matt, {outer}; opening {body.side_mm:g} × {body.side_mm:g} mm"),
        ("1", "back plate", f"{outer}; holes as on the page “from the back”"),
        *walls(body),
    ]


def _electric_parts(body: Body, circuit: Circuit) -> list[tuple[str, str, str]]:
    count = body.cells**2
    volts, example = next((v, name) for v, name in _MOSFETS if v >= circuit.mosfet_v)
    amperes = max(1.0, 3 * max(circuit.class_a))
    return [
        ("1", "Arduino Uno or Nano", CRYSTAL),
        (
            str(count * circuit.leds),
            f"LED, {body.led_mm:g} mm",
            f"white, {circuit.forward_v:g} V, wide beam (120°); all of one batch",
        ),
        (str(count), f"resistor {ohm_text(circuit.resistor_ohm)}", f"{circuit.resistor_rating_w:g} W, 1 %"),
        (
            "2",
            "MOSFET, N-channel",
            f"fully on at 4.5 V (logic level); from {volts} V and {amperes:.0f} A on; gate charge ≤ 20 nC:\n"
            f"{example}, for example",
        ),
        ("2 + 2", f"resistor {ohm_text(GATE_OHM)}, {ohm_text(PULL_DOWN_OHM)}", "0.125 W; pin to gate, and gate to GND"),
        ("1", "supply", f"{circuit.supply_v:g} V, {circuit.supply_rating_a:g} A; fuse, and 100 µF beside the panel"),
        ("1", "the Arduino's own supply", "USB charger of 5 V, and its cable; GND joined with the panel's"),
    ]


def walls(body: Body) -> list[tuple[str, str, str]]:
    """The walls between the cells and around them."""
    board = f"{body.wall_mm:g} mm thick, {body.depth_mm:g} mm high, white, opaque"
    outer = ("2 + 2", "outer wall", f"{body.side_mm:g} and {body.side_mm + 2 * body.wall_mm:g} mm long, {board}")
    if body.cells == 1:
        return [outer]
    return [(str(2 * (body.cells - 1)), "wall between cells", f"{body.side_mm:g} mm long, {board}"), outer]


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
