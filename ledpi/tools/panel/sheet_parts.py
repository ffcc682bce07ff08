"""Parts to buy for a panel, and what its electrics come to, as rows of text."""

from __future__ import annotations

from ledpi.tools.panel.body import Body
from ledpi.tools.panel.circuit import Circuit, ohm_text
from ledpi.tools.panel.schematic import GATE_OHM, PULL_DOWN_OHM

_MOSFETS = ((30, "AO3400A (SMD) or FQP30N06L (TO-220)"), (60, "FQP30N06L (TO-220)"), (100, "IRL520N (TO-220)"))
CRYSTAL = "ATmega328P, 5 V, 16 MHz; with a crystal, not a resonator"
_SPREAD_V = 0.1  # of LEDs of one batch


def electrics(circuit: Circuit) -> list[tuple[str, str]]:
    """Lists what, and how much."""
    spread_v = _SPREAD_V * circuit.leds
    low_ma, high_ma = (1e3 * (circuit.headroom_v + off_v) / circuit.resistor_ohm for off_v in (-spread_v, spread_v))
    black_ma, white_ma = (1e3 * amperes for amperes in circuit.class_a)
    series = "LEDs in series" if circuit.leds > 1 else "LED"
    rows = [
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
    return rows


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
