"""`ledpi panel firmware` as its user sees it: a folder that can be built, or one line that says why not."""

from __future__ import annotations

import re
import shutil
from functools import partial
from pathlib import Path

import pytest

from ledpi.cli import app, main, panel
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import LedpiError
from ledpi.core.records import PanelSpec
from ledpi.workshop.panel.firmware import Build, missing_tools, plan_firmware, settings_text
from tests.builders import ROOT
from tests.builders.command import output_of

SPEC = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
assert panel, main  # the import puts the command into `app`
pytestmark = pytest.mark.usefixtures("elsewhere")
run = partial(output_of, app, "panel", "firmware")


def defined(settings: str, name: str) -> str:
    """The value of a #define."""
    found = re.search(rf"^#define {name} (\S+)", settings, re.MULTILINE)
    assert found, name
    return found[1]


def test_two_outputs_for_the_usual_pair() -> None:
    """The sources, their settings, and a page that says what was made, to the ppm; however many cells there are."""
    told = run("--id", "7", "--black", "1250", "--white", "2450", "--out", "panel7")
    assert "6400 cycles  1250.0000 Hz  +0.0 ppm" in told
    assert "3265 cycles  2450.2297 Hz  +93.8 ppm" in told
    written = {path.name for path in Path("panel7").iterdir()}
    assert {"two_outputs.c", "settings.h", "Makefile", "README.md"} <= written
    settings = Path("panel7/settings.h").read_text()
    assert defined(settings, "BLACK_HALF_PERIOD_CYCLES") == "6400u"
    assert defined(settings, "WHITE_HALF_PERIOD_CYCLES") == "3265u"
    run("--id", "3", "--set", "panels.dictionary=DICT_6X6_50", "--out", "out")
    grids = re.findall(r"\n\n((?:    D.*\n)+)", Path("out/README.md").read_text())
    assert [len(grid.split()) for grid in grids] == [36, 36]


def test_the_page_shows_the_cells_from_both_sides() -> None:
    """ID 7 of DICT_4X4_50 reads 1100 / 0100 / 1111 / 0010; class white is on D10. The back is the mirror image."""
    run("--id", "7", "--out", "out")
    page = Path("out/README.md").read_text()
    front, back = ([line.split() for line in part.splitlines()] for part in re.findall(r"\n\n((?:    D.*\n){4})", page))
    assert front == [
        ["D10", "D10", "D9", "D9"],
        ["D9", "D10", "D9", "D9"],
        ["D10", "D10", "D10", "D10"],
        ["D9", "D9", "D10", "D9"],
    ]
    assert back == [row[::-1] for row in front]


def test_frequencies_come_from_the_configuration() -> None:
    """Also those of one ID's own panel; the command line overrides both. A measured duty is a half but for noise."""
    overrides = "overrides: {3: {black_hz: 1262}, 7: {duty: 0.502}, 8: {duty: 0.4}}"
    Path("config.yaml").write_text(f"panels: {{side_m: 0.3, white_hz: 2350, {overrides}}}")
    note = "ID 3 is reported only if panels.ids lists it: a part or a reflection of a panel can look the same"
    assert run("--id", "3", "--out", "configured").splitlines()[-1] == note
    settings = Path("configured/settings.h").read_text()
    assert "from 1262 Hz" in settings
    assert "from 2350 Hz" in settings
    assert "panels.ids" not in run("--id", "3", "--black", "1250", "--out", "overridden", "--set", "panels.ids=[3]")
    assert "from 1250 Hz" in Path("overridden/settings.h").read_text()
    run("--id", "7", "--out", "measured")
    with pytest.raises(LedpiError, match=r"^panels\.overrides\.8\.duty: .* must be 0\.5, not 0\.4"):
        run("--id", "8", "--out", "other")


def test_an_id_that_cannot_be_told_in_antiphase_is_refused() -> None:
    """38 of DICT_4X4_100 is the negative of 69; the page of another says which IDs there are."""
    one = ("--phase", "antiphase", "--white", "1253.33", "--set", "panels.dictionary=DICT_4X4_100")
    with pytest.raises(LedpiError, match="--id: DICT_4X4_100: ID 38 is the negative"):
        run("--id", "38", *one, "--out", "out")
    run("--id", "7", *one, "--out", "out")
    assert "Only the IDs 0 to 37, 39 to 68, 70 to 99 can be read so." in Path("out/README.md").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--id", "50"], "--id: DICT_4X4_50 has the IDs 0 to 49, not 50"),
        (["--white", "1250"], "black_hz and white_hz must differ"),
        (["--white", "1260"], r"1250 and 1260 Hz coincide: in the 16.2 ms .* must be 62 Hz apart .* and 619 Hz for"),
        (["--white", "3055"], r"white_hz: 3055 Hz is 131 ppm .* nearest are 3054.6010 Hz and 3055.7678 Hz"),
        (["--white", "2500"], r"white_hz: 2500 Hz is on a null: .* holds 24.92 .* nearest good one is 2457.76 Hz"),
        (["--black", "1000"], r"black_hz: 1000 Hz flickers: .* from 1250 Hz on; the nearest good one is 1253.33 Hz"),
        (["--white", "25000"], r"white_hz: 25000 Hz leaves the interrupts no time; the nearest is 20000.0000 Hz"),
        (["--phase", "antiphase"], "--black, --white, --phase: .* must be equal, not 1250 and 2450"),
        (["--phase", "antiphase", "--black", "1300", "--white", "1400"], "must be equal, not 1300 and 1400"),
        (["--phase", "antiphase", "--black", "1300"], "black_hz: 1300 Hz is on a null"),
        (["--white", "inf"], "white_hz: a frequency must be positive and finite, not inf"),
        (["--white", "-5"], "black_hz and white_hz must be positive"),
        (["--build", "sixteen-cells", "--set", "panels.dictionary=DICT_5X5_50"], "drives 4 × 4 cells, DICT_5X5_50 has"),
        (["--set", "panels.duty=0.3"], "panels.duty: .* must be 0.5, not 0.3"),
        (["--set", "panels.overrides={60: {side_m: 1}}"], "panels.overrides.60"),
        (["--config", "nowhere.yaml"], "nowhere.yaml: cannot be read"),
    ],
)
def test_what_cannot_be_driven_is_reported_in_one_line(arguments: list[str], message: str) -> None:
    """The option or key that is wrong, and what would be right; nothing is written."""
    with pytest.raises(LedpiError, match=message) as told:
        run("--id", "7", "--out", "out", *arguments)
    assert "\n" not in str(told.value)
    assert not Path("out").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ("--black", "1253.33", "--white", "2457.76"),  # as a refusal names them
        ("--white", "2500", "--set", "camera.exposure_us=150"),  # which has no nulls there
    ],
)
def test_what_helps_is_accepted(arguments: tuple[str, ...]) -> None:
    run("--id", "7", *arguments, "--out", "out")


def test_nothing_is_written_over(tmp_path: Path) -> None:
    """A folder that holds something is left alone."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out/precious.c").write_text("mine")
    with pytest.raises(LedpiError, match="not empty"):
        run("--id", "7", "--out", "out")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["precious.c"]


def test_without_a_compiler_the_sources_are_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """And the user is told what to install."""
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert "apt install gcc-avr avr-libc make" in run("--id", "7", "--out", "out")
    assert Path("out/two_outputs.c").exists()


@pytest.mark.slow
@pytest.mark.skipif(bool(missing_tools()), reason=f"not installed: {', '.join(missing_tools())}")
@pytest.mark.parametrize("build", list(Build))
def test_with_a_compiler_the_hex_is_made(build: Build) -> None:
    """Without a warning (they are errors); the 1000 words of the largest dictionary fit into the chip, too."""
    told = run("--id", "7", "--build", build, "--set", "panels.dictionary=DICT_4X4_1000", "--out", "out")
    hex_file = Path("out", build.source).with_suffix(".hex")
    assert str(hex_file) in told
    records = [bytes.fromhex(line[1:]) for line in hex_file.read_text().split()]
    assert 0 < sum(record[0] for record in records if record[3] == 0) < 30_000


def test_the_sources_in_the_repository_can_be_built_as_they_are() -> None:
    """Their settings.h is what the command writes for panel 7 at the usual frequencies."""
    planned = plan_firmware(
        Build.SIXTEEN_CELLS, load_dictionary("DICT_4X4_50"), 7, SPEC, exposure_us=9966.0, scan_time_s=0.016
    )
    assert (ROOT / "firmware/panel/settings.h").read_text(encoding="utf-8") == settings_text(planned)


def test_the_commands_in_the_guide_print_what_it_says() -> None:
    """Build your first panel: its commands are accepted, and the two lines it shows are the command's own."""
    guide = (ROOT / "docs/first-panel.md").read_text(encoding="utf-8")
    commands = re.findall(r"^    ledpi panel firmware (.+) --out driver\S*$", guide, re.MULTILINE)
    assert len(commands) == 3
    shown = re.findall(r"^    ((?:black|white)  \d.*)$", guide, re.MULTILINE)
    for number, command in enumerate(commands):
        assert run(*command.split(), "--out", f"driver{number}").splitlines()[:2] == shown
