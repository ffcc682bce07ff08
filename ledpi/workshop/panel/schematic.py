"""Schematics: the driver with two MOSFETs and the cells of both classes; or one of sixteen cells on a board's pins."""

from __future__ import annotations

from typing import TYPE_CHECKING

import schemdraw
from matplotlib.colors import to_hex
from schemdraw import elements as elm

from ledpi.workshop.panel.circuit import OUTPUTS, USB_V, Circuit, PinCircuit, ohm_text
from ledpi.workshop.panel.sheet_views import CLASS_COLOUR

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GATE_OHM, PULL_DOWN_OHM = 220.0, 10_000.0
SIZE_MM = (180.0, 112.0)
UNIT_MM = 8.0  # schemdraw's: a resistor is one long
BOARD = "Arduino\nUno or Nano\n(ATmega328P,\n5 V, 16 MHz)"
PLUS_Y, GROUND_Y = 13.0, 1.0
PIN_Y = {False: 2.9, True: 4.75}  # by class; True is white


def draw_schematic(axes: Axes, circuit: Circuit, frequencies_hz: tuple[float, float]) -> None:
    """On an area of SIZE_MM."""
    volts = next(v for v in (10, 16, 25, 35, 50, 63) if v >= 1.25 * circuit.supply_v)
    supply = f"{circuit.supply_v:g} V\n{circuit.supply_rating_a:g} A"
    with _drawing(axes):
        elm.Line().endpoints((1, PLUS_Y), (19.5, PLUS_Y))
        elm.Line().endpoints((1, GROUND_Y), (18, GROUND_Y))
        elm.Fuse().endpoints((1, PLUS_Y), (1, 11)).label(f"fuse\n{circuit.supply_rating_a:g} A", "bottom")
        elm.BatteryCell().endpoints((1, 11), (1, GROUND_Y)).label(supply, "bottom")
        elm.Capacitor().endpoints((4, PLUS_Y), (4, 11)).label(f"100 µF\n{volts} V", "bottom")
        elm.Ground().at((4, 11))
        _board((3, 2), (6.5, 8.5), f"{BOARD}\n\nUSB: 5 V")
        elm.Line().endpoints((4.75, 2), (4.75, GROUND_Y))
        for white, x in ((False, 11.5), (True, 18.0)):
            _class(circuit, white, frequencies_hz[white], x)


def _class(circuit: Circuit, white: bool, hz: float, x: float) -> None:
    """One class: two of its cells, its MOSFET, and the way from the Arduino's pin to the gate."""
    colour, name = to_hex(CLASS_COLOUR[white]), "white" if white else "black"
    for cell_x in (x - 1, x + 1):
        _cell(circuit, cell_x)
    _text("…", (x, 10), 14)
    _text(f"{circuit.cells[white]} cells\nof class\n{name}", (x + 2.7, 11), 7.5, colour)
    elm.Line().endpoints((x - 1, 6.5), (x + 1, 6.5)).color(colour)
    _text(OUTPUTS[white], (5.95, PIN_Y[white]), 8, colour)
    elm.Dot().at((x, 6.5)).color(colour)
    gate = elm.NFet(bulk=True).anchor("drain").at((x, 4.5)).theta(0).reverse()
    elm.Line().endpoints(gate.bulk, gate.source)
    elm.Line().endpoints((x, 6.5), (x, 4.5)).color(colour)
    _text(f"{1e3 * circuit.class_a[white]:.0f} mA\n{hz:g} Hz", (x + 0.9, 5.6), 7, colour)
    elm.Line().endpoints(gate.source, (x, GROUND_Y)).dot()
    gate_x, gate_y = gate.gate
    for letter, at in (("D", (x + 0.25, 4.4)), ("S", (x + 0.25, 3.0)), ("G", (gate_x, gate_y + 0.3))):
        _text(letter, at, 6)
    start = gate_x - 2.6
    elm.Line().endpoints((6.5, PIN_Y[white]), (start, PIN_Y[white])).color(colour)
    elm.Line().endpoints((start, PIN_Y[white]), (start, gate_y)).color(colour)
    elm.ResistorIEC().endpoints((start, gate_y), (gate_x - 0.6, gate_y)).label(ohm_text(GATE_OHM))
    elm.Line().endpoints((gate_x - 0.6, gate_y), (gate_x, gate_y))
    elm.Dot().at((gate_x - 0.6, gate_y))
    pull_down = elm.ResistorIEC().endpoints((gate_x - 0.6, gate_y), (gate_x - 0.6, GROUND_Y)).dot()
    pull_down.label(ohm_text(PULL_DOWN_OHM))


def _cell(circuit: Circuit, x: float) -> None:
    """A string: the LEDs, at most three of them drawn, and the resistor."""
    drawn = min(circuit.leds, 3)
    elm.Dot().at((x, PLUS_Y))
    for number in range(drawn):
        elm.LED().endpoints((x, PLUS_Y - 1.4 * number), (x, PLUS_Y - 1.4 * (number + 1)))
    low = PLUS_Y - 1.4 * drawn
    if circuit.leds > drawn:
        _text(f"⋮ {circuit.leds} in all", (x - 0.6, low), 6)
    elm.ResistorIEC().endpoints((x, low), (x, 6.5)).label(ohm_text(circuit.resistor_ohm), fontsize=6.5)


def draw_pins_schematic(axes: Axes, circuit: PinCircuit) -> None:
    """One of the sixteen cells; on an area of SIZE_MM."""
    with _drawing(axes):
        _board((2.5, 5), (8.25, 11.25), f"{BOARD}\n\nUSB: {USB_V:g} V")
        _text("the cell's pin", (7, 10), 7)
        elm.ResistorIEC().endpoints((8.25, 10), (16, 10)).label(ohm_text(circuit.resistor_ohm), fontsize=8)
        elm.LED().endpoints((16, 10), (16, 4))
        elm.Ground().at((16, 4))
        elm.Line().endpoints((5.4, 5), (5.4, 4))
        elm.Ground().at((5.4, 4))
        _text("long leg (+) to the resistor", (19.2, 9), 7)
        _text("sixteen times, once for each cell:\nD2 to D13, A0 to A3. All short legs\ngo to GND.", (19.4, 5.5), 7)


def _drawing(axes: Axes) -> schemdraw.Drawing:
    """A drawing of the elements that are made within it."""
    axes.set_xlim(0, SIZE_MM[0] / UNIT_MM)
    axes.set_ylim(0, SIZE_MM[1] / UNIT_MM)
    drawing = schemdraw.Drawing(canvas=axes)
    drawing.config(unit=1, fontsize=7, lw=0.9)
    return drawing


def _board(low: tuple[float, float], high: tuple[float, float], text: str) -> None:
    elm.Rect(low, high, lw=1.2).at((0, 0)).theta(0)
    _text(text, ((low[0] + high[0]) / 2 - 0.2, (low[1] + high[1]) / 2 + 0.6), 7)
    _text("GND", ((low[0] + high[0]) / 2, low[1] + 0.4), 8)


def _text(text: str, at: tuple[float, float], size: float, colour: str = "black") -> None:
    elm.Label().at(at).theta(0).label(text, halign="center", valign="center", fontsize=size).color(colour)
