"""Values in documents are those of the code: keys and defaults, depths of bands, parts."""

from __future__ import annotations

import re
from typing import Any

import pytest
import yaml

from ledpi.config.panels import PanelOverride
from ledpi.config.settings import Config, load_config
from ledpi.config.shipped import documented
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import ConfigError
from ledpi.core.shutter import contrast
from ledpi.workshop.panel.body import Body
from ledpi.workshop.panel.circuit import Circuit, Lamps, ohm_text, plan_circuit, plan_pins
from ledpi.workshop.panel.sheet_parts import parts
from tests.builders import ROOT
from tests.builders.config import known_keys, written_values


def page(name: str) -> str:
    """A document's text."""
    return (ROOT / name).read_text(encoding="utf-8")


def rows_of(text: str, columns: int) -> list[list[str]]:
    """The rows of all tables with so many columns, without their heads."""
    lines = [re.split(r" *(?<!\\)\| *", line.strip())[1:-1] for line in text.splitlines() if line.startswith("|")]
    return [cells for cells in lines if len(cells) == columns and cells[0].startswith("`")]


KEYS = documented()
RANGES = {
    key: (float(found[1]), float(found[2]))
    for key, row in KEYS.items()
    if (found := re.match(r"(-?[\d.]+) to (-?[\d.]+)(?!.* each)", row.allowed)) is not None
}


def test_every_key_is_on_its_page() -> None:
    """Each of the configuration, and each that an override may hold; and no other."""
    assert KEYS.keys() == known_keys(Config)
    overriding = [cells[0].strip("`") for cells in rows_of(page("docs/configuration.md"), 3)]
    assert sorted(overriding) == sorted(PanelOverride.model_fields)


def test_the_defaults_on_the_page_are_those_of_the_file() -> None:
    """As YAML; the one key without a default has none."""
    shipped = written_values(yaml.safe_load((ROOT / "config.yaml").read_text(encoding="utf-8")))
    told: dict[str, Any] = {key: yaml.safe_load(row.default) for key, row in KEYS.items()}
    assert told.pop("panels.side_m") == "none"
    assert told == {key: value for key, value in shipped.items() if key != "panels.side_m"}


def test_every_key_has_a_meaning_or_a_range() -> None:
    """No row is left empty, and the live page shows it without marks of Markdown."""
    assert [key for key, row in KEYS.items() if not (row.meaning or row.allowed)] == []
    assert [key for key, row in KEYS.items() if re.search(r"`|\]\(|\*", "".join(row))] == []


def given(key: str, value: float) -> Config:
    """A configuration with that value of a key."""
    whole = key in ("camera.width", "camera.height", "serial.baud")
    size = () if key == "panels.side_m" else ("panels.side_m=0.16",)
    return load_config(None, (*size, f"{key}={round(value) if whole else repr(value)}"))


def test_the_ranges_on_the_page_are_those_that_are_accepted() -> None:
    """Either end is, and what lies beyond it is not."""
    for key, (low, high) in RANGES.items():
        for value in (low, high):
            assert given(key, value)
        for end, away in ((low, -1), (high, 1)):
            with pytest.raises(ConfigError, match=key):
                given(key, end + away * max(1e-3 * end, 1.0 if end > 30 else 0.0))


def test_how_deep_bands_are() -> None:
    """The table has what the shutter's equation gives; no other page repeats a depth of either frequency."""
    text = page("docs/frequencies.md")
    rows = re.findall(r"^\| (\d+) µs.* \| ([\d.]+) %.* \| ([\d.]+) % \|$", text, re.MULTILINE)
    assert [row[0] for row in rows] == ["10000", "9967", "150"]
    for exposure_us, *told in rows:
        for frequency_hz, depth in zip((1250.0, 2450.0), told, strict=True):
            assert float(depth) == pytest.approx(100.0 * contrast(frequency_hz, float(exposure_us)), abs=0.05)
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    others = [path for path in pages if path.name not in ("frequencies.md", "results.md")]  # the latter is generated
    repeated = r"[\d.]+ % (?:of the light )?at (?:1250|2450) Hz"
    assert [path.name for path in others if re.search(repeated, path.read_text(encoding="utf-8"))] == []


@pytest.fixture(scope="module")
def circuit() -> Circuit:
    """The circuit of panel 7, as `ledpi panel sheet 7` plans it."""
    white = int(load_dictionary("DICT_4X4_50").codeword(7).sum())
    return plan_circuit(Lamps(supply_v=12.0, leds=None, forward_v=3.2, current_a=0.02), (16 - white, white))


def test_the_currents_of_the_panel_on_sixteen_pins() -> None:
    """Step 0 names what `ledpi panel sheet --direct` computes."""
    circuit, guide = plan_pins(3.2, 0.0075), page("docs/first-panel.md")
    assert f"| 16 | resistor, {ohm_text(circuit.resistor_ohm)} |" in guide
    assert f"{1e3 * circuit.usual_a:.1f} mA. The worst case is the highest voltage of USB" in guide
    assert f"| a pin | {1e3 * circuit.most_a:.1f} mA |" in guide
    for name, amperes in circuit.ports_most_a().items():
        assert f"| the ports {name} | {1e3 * amperes:.0f} mA |" in guide
    assert f"its own | {1e3 * circuit.chip_most_a:.0f} mA |" in guide
    assert f"about {circuit.luminance(30.0):.0f} cd/m²" in guide
    assert f"{100 * circuit.own_share(30.0):.0f} % of its light is its own" in guide


def test_the_parts_of_the_first_panel(circuit: Circuit) -> None:
    """README and guide name as many as the sheet."""
    body = Body(codeword=load_dictionary("DICT_4X4_50").codeword(7), side_mm=160.0, leds=circuit.leds)
    pieces = {part: count for count, part, _ in parts(body, circuit)}
    leds, walls = pieces[f"LED, {body.led_mm:g} mm"], pieces["wall between cells"]
    guide, readme = page("docs/first-panel.md"), page("README.md")
    assert f"| {leds} | white LED, {body.led_mm:g} mm" in guide
    assert f"| 16 | resistor, {ohm_text(circuit.resistor_ohm)}," in guide
    assert f"| {walls} and 4 | walls" in guide
    assert f"{circuit.supply_v:g} V and {circuit.supply_rating_a:g} A" in guide
    assert f"draws {circuit.panel_w:.1f} W" in guide
    assert pieces["the Arduino's own supply"] == "1"
    assert "USB charger" in guide
    assert "USB charger" in readme
    assert f"{leds} white LEDs, 16 resistors" in readme
    assert f"a supply of {circuit.supply_rating_a:g} A" in readme
    assert f"about {circuit.panel_w:.0f} W" in readme
