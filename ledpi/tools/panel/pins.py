"""One LED with its resistor in each cell, straight from a pin of the board: no transistors, no supply. Pure arithmetic.

The board is an Arduino Uno or Nano with the sixteen-cell program. The currents are those of a chip whose sixteen pins
are all high at once, as two free frequencies now and then are, at the most that USB gives and the least that an LED
takes. All of them are below what the ATmega328P's data sheet allows, and the ATmega328PB's, which allows less.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ledpi.core.errors import ConfigError
from ledpi.tools.panel.circuit import next_e24
from ledpi.tools.panel.firmware import CELL_PINS

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
_HEADROOM_V = 0.5  # for the resistor, so that LEDs that differ by 0.1 V differ by a fifth of their light at most

_LUMEN_PER_A = 150.0  # of a common white LED of 5 mm: 3 lm at 20 mA
# Of its light, what leaves a box of white card through a sheet of paper: either loses a half.
_BOX_SHARE = 0.25
_PAPER_REFLECTS = 0.8
ROOM_LUX = 300.0  # a lit room


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
    if USB_V - forward_v < _HEADROOM_V:
        raise ConfigError(
            f"--led-voltage {forward_v:g}: a pin gives {USB_V:g} V, and {_HEADROOM_V:g} V are for the resistor; must "
            f"be at most {USB_V - _HEADROOM_V:g} V"
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
