"""The panel on a board's sixteen pins: currents within what the chip may give, and its sheet."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import pytest

from ledpi.cli import app, main, panel, panel_design
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import ConfigError
from ledpi.core.records import PanelSpec
from ledpi.workshop.panel.circuit import plan_pins
from ledpi.workshop.panel.sheet import Sheet, sheet_pages
from ledpi.workshop.panel.sheet_parts import pin_electrics, pin_parts
from tests.builders.command import output_of
from tests.unit.workshop.panel.test_sheet import body, words

assert panel_design, panel
assert main  # the imports put the commands into `app`
FRONT = ["D2 D3 D4 D5", "D6 D7 D8 D9", "D10 D11 D12 D13", "A0 A1 A2 A3"]
pytestmark = pytest.mark.usefixtures("elsewhere")
run = partial(output_of, app, "panel")


def test_currents_and_light_by_hand() -> None:
    """5 V − 3.2 V over 220 Ω and a pin's 25 Ω; at the worst 5.25 V − 3.0 V; 7, 9 and 16 pins, and 20 mA.

    150 lm/A, on for half of the time, a quarter leaves a cell of 3 × 3 cm; 300 lx on paper are 76 cd/m².
    """
    circuit = plan_pins(3.2, 0.0075)
    assert circuit.resistor_ohm == 220.0
    assert circuit.usual_a == pytest.approx(1.8 / 245)
    assert circuit.most_a == pytest.approx(2.25 / 245)
    assert circuit.ports_most_a() == pytest.approx({"A0–A5, D0–D4": 7 * 2.25 / 245, "D5–D13": 9 * 2.25 / 245})
    assert circuit.chip_most_a == pytest.approx(16 * 2.25 / 245 + 0.02)
    own = 150 * (1.8 / 245) / 2 * 0.25 / (3.14159 * 0.03**2)
    assert circuit.luminance(30.0) == pytest.approx(own, rel=1e-4)
    assert circuit.own_share(30.0) == pytest.approx(own / (own + 76.39), rel=1e-3)


@pytest.mark.parametrize("forward_v", [1.6, 3.2, 4.0])
def test_no_current_that_is_planned_is_above_the_chips_limits(forward_v: float) -> None:
    """Tries any LED and any current: 20 mA a pin, 100 mA a group of ports, 200 mA in all; or it is refused."""
    planned = []
    for tenths in range(10, 300):
        try:
            planned.append(plan_pins(forward_v, 1e-4 * tenths))
        except ConfigError:
            continue
    assert planned
    for circuit in planned:
        assert circuit.most_a <= 0.020
        assert max(circuit.ports_most_a().values()) <= 0.100
        assert circuit.chip_most_a <= 0.200


def test_a_current_that_is_refused_names_one_that_is_not() -> None:
    """And an LED that 5 V cannot drive is refused."""
    with pytest.raises(ConfigError, match=r"^--led-ma 20: .* 16 pins 387 mA; must be at most 8\.8") as told:
        plan_pins(3.2, 0.020)
    plan_pins(3.2, 1e-3 * float(re.findall(r"at most ([\d.]+)", str(told.value))[0]))
    with pytest.raises(ConfigError, match=r"^--led-voltage 4\.8: .* must be at most 4\.5 V"):
        plan_pins(4.8, 0.0075)


@pytest.mark.slow
def test_the_sheet_shows_each_cells_pin_from_both_sides() -> None:
    """Row by row from the front; the back is the mirror image."""
    sheet = Sheet(
        dictionary=load_dictionary("DICT_4X4_50"),
        marker_id=7,
        spec=PanelSpec(side_m=0.12, black_hz=1250, white_hz=2450),
        circuit=plan_pins(3.2, 0.0075),
        body=body(120.0, leds=1),
    )
    pages = dict(sheet_pages(sheet))
    front, back = (words(pages[side], r"[AD]\d+") for side in ("front", "back"))
    assert [" ".join(row) for row in front] == FRONT
    assert back == [row[::-1] for row in front]


def test_the_parts_are_sixteen_leds_and_no_transistor() -> None:
    """Straight from the pins: nothing but LEDs, resistors and wires."""
    pieces = {part: count for count, part, _ in pin_parts(body(120.0, leds=1), plan_pins(3.2, 0.0075))}
    assert pieces["LED, 5 mm"] == pieces["resistor 220 Ω"] == "16"
    assert not any("MOSFET" in part for part in pieces)
    assert ("the chip, at most", "167 mA, 20 mA of its own; 200 mA may go in") in pin_electrics(
        plan_pins(3.2, 0.0075), 30.0
    )


@pytest.mark.slow
def test_the_command_writes_it() -> None:
    """And names what does not go with pins."""
    assert run("sheet", "7", "--direct", "--side", "0.12", "--out", "sheet").split() == ["sheet/panel-7.pdf"]
    for arguments, message in (
        (["--supply", "12"], "^--supply 12: with --direct .* leave it out"),
        (["--leds", "3"], "^--leds 3: .* must be 1 with --direct"),
        (["--set", "panels.dictionary=DICT_5X5_50"], "^--direct: an Uno has pins for 16 cells, DICT_5X5_50 has 25"),
    ):
        with pytest.raises(ConfigError, match=message):
            run("sheet", "7", "--direct", "--out", "other", *arguments)
    assert not Path("other").exists()


@pytest.mark.slow
def test_the_rooms_light_and_the_gains_noise_cost_range() -> None:
    """The guide's three figures are the tool's, and its lit room reads less far than its dark one."""
    guide = (Path(__file__).parents[4] / "docs/first-panel.md").read_text(encoding="utf-8")
    antiphase = [f"panels.{key}" for key in ("phase=antiphase", "black_hz=1253.33", "white_hz=1253.33", "side_m=0.12")]
    told = []
    for command in re.findall(r"^    ledpi panel (design --check 1253.+?)\s+#", guide, re.MULTILINE):
        words = [*command.split(), *(word for key in antiphase for word in ("--set", key))]
        told.append(re.findall(r"is read (?:to )?(.+?) in a single picture, to (.+?) within 4", run(*words))[0])
    assert told == [("1.2 m", "3.0 m"), ("nowhere", "1.3 m")]
    assert "| dark | to 1.2 m | to 3.0 m |\n| lit, 300 lx | nowhere | to 1.3 m |" in guide
