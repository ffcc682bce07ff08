"""The electrics of a panel: LEDs and resistors behind two MOSFETs, or on the sixteen pins of a board. Pure arithmetic.

The board is an Arduino Uno or Nano with the sixteen-cell program. The currents are those of a chip whose sixteen pins
are all high at once, as two free frequencies now and then are, at the most that USB gives and the least that an LED
takes. All of them are below what the ATmega328P's data sheet allows, and the ATmega328PB's, which allows less.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ledpi.core.errors import ConfigError

# IEC 60063, two digits.
_E24 = (10, 11, 12, 13, 15, 16, 18, 20, 22, 24, 27, 30, 33, 36, 39, 43, 47, 51, 56, 62, 68, 75, 82, 91)
_RATINGS_W = (0.125, 0.25, 0.5, 1.0, 2.0, 3.0, 5.0)  # of resistors that are easily had
_SUPPLIES_V = (5.0, 9.0, 12.0, 15.0, 19.0, 24.0, 36.0, 48.0)
_SUPPLY_RATINGS_A = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 10.0)
# LEDs of one batch differ by 0.1 V or so. With half a volt a LED over the resistor, cells then differ by a fifth of
# their light at most, which the decoder takes out as the cells' gains.
_HEADROOM_V = 0.5
_MAX_LEDS = 9  # in a cell
_MAX_SUPPLY_V = 48.0  # above 60 V direct current is no longer safe to touch

OUTPUTS = {False: "D9", True: "D10"}  # by class; True is white
CELL_PINS = (*(f"D{n}" for n in range(2, 14)), *(f"A{n}" for n in range(4)))  # cell by cell, row by row
USB_V, USB_MOST_V = 5.0, 5.25
PIN_OHM = 25.0  # of an output at 5 V: 20 mA leave 4.5 V, typically
PIN_MOST_A = 0.020  # the data sheet's test condition; damage is possible from 40 mA on
# The sums that the data sheet allows to be drawn from these ports: 150 mA each, of an ATmega328PB 100 mA.
PORTS = {
    "A0–A5, D0–D4": frozenset({*(f"A{n}" for n in range(6)), *(f"D{n}" for n in range(5))}),
    "D5–D13": frozenset(f"D{n}" for n in range(5, 14)),
}
PORTS_MOST_A = 0.100
CHIP_MOST_A = 0.200  # through its VCC pin: damage is possible beyond
CHIP_OWN_A = 0.020  # of the chip itself at 16 MHz, 12 mA, and of the board's own LED at D13
_SPREAD_V = 0.2  # by which an LED takes less than its data sheet's usual value
_PIN_HEADROOM_V = 0.5  # for the resistor, so that LEDs that differ by 0.1 V differ by a fifth of their light at most
_LUMEN_PER_A = 150.0  # of a common white LED of 5 mm: 3 lm at 20 mA
# Of its light, what leaves a box of white card through a sheet of paper: either loses a half.
_BOX_SHARE = 0.25
_PAPER_REFLECTS = 0.8
ROOM_LUX = 300.0  # a lit room


@dataclass(frozen=True, slots=True, kw_only=True)
class Circuit:
    """Needs of each cell and each class. Currents are those while a class is on; that is half of the time."""

    supply_v: float
    leds: int  # in series, in each cell
    forward_v: float  # of one LED
    cells: tuple[int, int]  # of class black, of class white
    resistor_ohm: float

    @property
    def headroom_v(self) -> float:
        """Left for the resistor."""
        return self.supply_v - self.leds * self.forward_v

    @property
    def cell_a(self) -> float:
        """Through one cell's string."""
        return self.headroom_v / self.resistor_ohm

    @property
    def class_a(self) -> tuple[float, float]:
        """Through either MOSFET."""
        return self.cells[0] * self.cell_a, self.cells[1] * self.cell_a

    @property
    def resistor_w(self) -> float:
        """In one resistor while it is on, as it stays where a program stops with its pin high."""
        return self.cell_a**2 * self.resistor_ohm

    @property
    def resistor_rating_w(self) -> float:
        """The next rating of twice that, or of what there is."""
        return next((w for w in _RATINGS_W if w >= 2 * self.resistor_w), _RATINGS_W[-1])

    @property
    def panel_w(self) -> float:
        """Returns the whole panel's, averaged over the blinking."""
        return 0.5 * self.supply_v * sum(self.class_a)

    @property
    def supply_rating_a(self) -> float:
        """With both classes on at once, and a quarter to spare."""
        needed = 1.25 * sum(self.class_a)
        return next((a for a in _SUPPLY_RATINGS_A if a >= needed), math.ceil(needed))

    @property
    def mosfet_v(self) -> float:
        """That a MOSFET must stand: twice the supply, for what wires add when they are switched."""
        return 2 * self.supply_v


@dataclass(frozen=True, slots=True, kw_only=True)
class Lamps:
    """Demands on the LEDs."""

    supply_v: float
    leds: int | None  # in series, in each cell; None: as many as the supply carries, four at most
    forward_v: float  # of one
    current_a: float  # while they are on


def plan_circuit(lamps: Lamps, cells: tuple[int, int]) -> Circuit:
    """Chooses the resistor: the E24 value that gives the current or a little less.

    Raises ConfigError where the supply is too low, or too high, with what would do.
    """
    supply_v, forward_v = lamps.supply_v, lamps.forward_v
    if supply_v > _MAX_SUPPLY_V:
        raise ConfigError(f"--supply {supply_v:g}: must be at most {_MAX_SUPPLY_V:g} V, which is safe to touch")
    most = int(supply_v / (forward_v + _HEADROOM_V) + 1e-9)
    wanted = min(4, max(1, most)) if lamps.leds is None else lamps.leds
    if not 1 <= wanted <= _MAX_LEDS:
        raise ConfigError(f"--leds {wanted}: must be 1 to {_MAX_LEDS}")
    if wanted > most:
        raise ConfigError(_too_low(supply_v, wanted, forward_v, most))
    headroom_v = supply_v - wanted * forward_v
    circuit = Circuit(
        supply_v=supply_v,
        leds=wanted,
        forward_v=forward_v,
        cells=cells,
        resistor_ohm=next_e24(headroom_v / lamps.current_a),
    )
    if circuit.resistor_w > _RATINGS_W[-1]:
        remedy = f"more LEDs in series (--leds {most})" if most > wanted else "less current (--led-ma)"
        raise ConfigError(
            f"--supply {supply_v:g}: each cell's resistor would turn {circuit.resistor_w:.1f} W into heat; must be "
            f"nearer to {wanted * (forward_v + _HEADROOM_V):.1f} V, or {remedy}"
        )
    return circuit


def _too_low(supply_v: float, leds: int, forward_v: float, most: int) -> str:
    needed_v = leds * (forward_v + _HEADROOM_V)
    better_v = next((v for v in _SUPPLIES_V if v >= needed_v), None)
    remedies = [f"--supply {better_v:g}"] if better_v is not None else []
    remedies += [f"--leds {most}"] if most else []
    return (
        f"--supply {supply_v:g}: is too low for {leds} × {forward_v:g} V of LEDs in series: they need {needed_v:.1f} "
        f"V, {_HEADROOM_V:g} V a LED left for the resistor; must be {' or '.join(remedies)}"
    )


def next_e24(ohm: float) -> float:
    """The smallest E24 value that is not below `ohm`."""
    decade = 10.0 ** (math.floor(math.log10(ohm)) - 1)
    for step in (*_E24, 100):
        if step * decade >= ohm * (1 - 1e-9):
            return float(f"{step * decade:.2g}")
    raise AssertionError("a decade ends at 100")


def ohm_text(ohm: float) -> str:
    """As it is printed on a reel: 150 Ω, 4.7 kΩ."""
    return f"{ohm / 1000:g} kΩ" if ohm >= 1000 else f"{ohm:g} Ω"


@dataclass(frozen=True, slots=True, kw_only=True)
class PinCircuit:
    """Loads of each pin. Currents are those while it is high, half of the time."""

    forward_v: float
    resistor_ohm: float

    @property
    def usual_a(self) -> float:
        """Through a cell's LED."""
        return (USB_V - self.forward_v) / (self.resistor_ohm + PIN_OHM)

    @property
    def most_a(self) -> float:
        """The same at the most that USB gives, with an LED that takes least."""
        return (USB_MOST_V - self.forward_v + _SPREAD_V) / (self.resistor_ohm + PIN_OHM)

    def ports_most_a(self) -> dict[str, float]:
        """Returns the most of each group of ports that the data sheet has a sum for, all their cells lit."""
        return {name: self.most_a * len(pins.intersection(CELL_PINS)) for name, pins in PORTS.items()}

    @property
    def chip_most_a(self) -> float:
        """Into the chip, all cells lit."""
        return self.most_a * len(CELL_PINS) + CHIP_OWN_A

    def luminance(self, pitch_mm: float) -> float:
        """Mean cd/m² of a cell behind paper, averaged over its blinking. LEDs and boxes differ by a factor of two."""
        lumen = _LUMEN_PER_A * self.usual_a / 2
        return _BOX_SHARE * lumen / (math.pi * (1e-3 * pitch_mm) ** 2)

    def own_share(self, pitch_mm: float) -> float:
        """Share of the panel's own light in what a camera sees in a lit room: its paper reflects the rest."""
        own, room = self.luminance(pitch_mm), _PAPER_REFLECTS * ROOM_LUX / math.pi
        return own / (own + room)


def plan_pins(forward_v: float, current_a: float) -> PinCircuit:
    """Chooses the resistor: the E24 value that gives the current or a little less.

    Raises ConfigError where USB's 5 V are too low for the LED, or a pin or the chip would give more than it may.
    """
    if USB_V - forward_v < _PIN_HEADROOM_V:
        raise ConfigError(
            f"--led-voltage {forward_v:g}: a pin gives {USB_V:g} V, and {_PIN_HEADROOM_V:g} V are for the resistor; "
            f"must be at most {USB_V - _PIN_HEADROOM_V:g} V"
        )
    ohm = (USB_V - forward_v) / current_a - PIN_OHM
    planned = PinCircuit(forward_v=forward_v, resistor_ohm=next_e24(max(ohm, 1.0)))
    allowed = _most_pin_a()
    if planned.most_a > allowed:
        ratio = allowed / planned.most_a
        raise ConfigError(
            f"--led-ma {1e3 * current_a:g}: a pin may give {1e3 * planned.most_a:.1f} mA then, and 16 pins "
            f"{1e3 * 16 * planned.most_a:.0f} mA; must be at most {math.floor(1e4 * ratio * planned.usual_a) / 10:g}, "
            f"{1e3 * allowed:.1f} mA a pin at the worst"
        )
    return planned


def _most_pin_a() -> float:
    """That a pin may give while all others give the same."""
    ports = [PORTS_MOST_A / len(pins.intersection(CELL_PINS)) for pins in PORTS.values()]
    return min(PIN_MOST_A, (CHIP_MOST_A - CHIP_OWN_A) / len(CELL_PINS), *ports)
