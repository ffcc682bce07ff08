"""`ledpi panel sheet`: what a builder gets on paper, and what is refused."""

from __future__ import annotations

import re
import zlib
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes

from ledpi.cli import app, main, panel
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import ConfigError
from ledpi.core.records import PanelSpec
from ledpi.workshop.panel.body import Body
from ledpi.workshop.panel.circuit import Circuit, Lamps, next_e24, plan_circuit
from ledpi.workshop.panel.paper import Page, write_pdf
from ledpi.workshop.panel.sheet import Sheet, sheet_pages
from tests.builders.command import output_of

assert panel, main  # the import puts the command into `app`
POINTS_PER_MM = 72 / 25.4
WORD_7 = ["WWBB", "BWBB", "WWWW", "BBWB"]  # of DICT_4X4_50: 1100 / 0100 / 1111 / 0010
pytestmark = pytest.mark.usefixtures("elsewhere")
run = partial(output_of, app, "panel", "sheet")


def circuit(supply_v: float = 12.0, leds: int | None = None, current_a: float = 0.02) -> Circuit:
    return plan_circuit(Lamps(supply_v=supply_v, leds=leds, forward_v=3.2, current_a=current_a), (8, 8))


def body(side_mm: float = 160.0, leds: int = 3) -> Body:
    return Body(codeword=load_dictionary("DICT_4X4_50").codeword(7), side_mm=side_mm, leds=leds)


@cache
def pages(side_mm: float = 160.0) -> dict[str, Page]:
    """Returns those of ID 7."""
    sheet = Sheet(
        dictionary=load_dictionary("DICT_4X4_50"),
        marker_id=7,
        spec=PanelSpec(side_m=1e-3 * side_mm, black_hz=1250, white_hz=2450),
        circuit=circuit(),
        body=body(side_mm),
    )
    return dict(sheet_pages(sheet))


def words(page: Page, pattern: str = "B|W") -> list[list[str]]:
    """Those of cells that a page shows, row by row, as they are placed on it."""
    placed = [
        (round(text.get_position()[1] / 10), text.get_position()[0], text.get_text())
        for axes in page.figure.axes
        for text in axes.texts
        if re.fullmatch(pattern, text.get_text())
    ]
    rows = sorted({y for y, _, _ in placed}, reverse=True)
    return [[word for y, _, word in sorted(placed, key=lambda p: p[1]) if y == row] for row in rows]


def pdf_lines_mm(path: Path) -> list[list[float]]:
    """(x0, y0, x1, y1) of each straight line that a PDF draws by itself, over all its pages."""
    lines = []
    for stream in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", path.read_bytes(), re.DOTALL):
        try:
            text = zlib.decompress(stream).decode("latin-1")
        except zlib.error:
            continue
        found = re.findall(r"^([\d.]+) ([\d.]+) m\n([\d.]+) ([\d.]+) l\s+S$", text, re.MULTILINE)
        lines += [[float(value) / POINTS_PER_MM for value in line] for line in found]
    return lines


def test_resistors_are_of_the_e24_series() -> None:
    """The next one that is not below, so that the current is not above."""
    asked = [120.0, 121.0, 445.0, 95.0, 9.2, 0.5, 9100.5]
    assert [next_e24(ohm) for ohm in asked] == [120.0, 130.0, 470.0, 100.0, 10.0, 0.51, 10000.0]


def test_the_usual_supply_carries_three_leds_a_cell() -> None:
    """12 V − 3 · 3.2 V = 2.4 V over 120 Ω are 20 mA, and 48 mW."""
    usual = circuit()
    assert (usual.leds, usual.resistor_ohm) == (3, 120.0)
    assert usual.cell_a == pytest.approx(0.020)
    assert usual.resistor_w == pytest.approx(0.048)
    assert usual.resistor_rating_w == 0.125
    assert usual.class_a == pytest.approx((0.16, 0.16))
    assert usual.panel_w == pytest.approx(12 * 0.32 / 2)


@pytest.mark.parametrize(
    ("supply_v", "leds", "current_a", "says"),
    [
        (12.0, 4, 0.02, r"--supply 12:.*need 14\.8 V.* must be --supply 15 or --leds 3"),  # 4 · 3.2 V and 4 · ½ V
        (3.0, None, 0.02, r"--supply 3: .*must be --supply 5$"),
        (60.0, None, 0.02, "at most 48 V"),  # to touch
        (24.0, 1, 1.0, r"resistor would turn 19\.7 W into heat; .* \(--leds 6\)"),
        (12.0, None, 3.0, r"must be nearer to 11\.1 V, or less current"),  # 3 · 3.2 V and 3 · ½ V
    ],
)
def test_a_supply_that_will_not_do_is_refused(supply_v: float, leds: int | None, current_a: float, says: str) -> None:
    """Too low or too high, with what would do."""
    with pytest.raises(ConfigError, match=says):
        circuit(supply_v, leds, current_a)


def test_walls_hide_no_light_that_is_read() -> None:
    """At most 6 % of a cell, of boards that are to be had; the LEDs stand back as far as they must to light a cell."""
    assert [body(side_mm).wall_mm for side_mm in (160.0, 300.0, 80.0)] == [2.0, 3.0, 1.0]
    assert body(leds=1).depth_mm == 38.0  # 28.3 mm to the corner, over 0.76
    assert body(leds=4).depth_mm == 19.0


def test_cells_without_room_for_their_leds_are_refused() -> None:
    """Two LEDs of 3 mm side by side, 3 mm between them, four cells: 48 mm."""
    with pytest.raises(ConfigError, match=r"cell of 10\.0 mm has no room for 3 LEDs .* at least 0\.048 m"):
        body(side_mm=40.0)
    assert body(side_mm=48.0).led_mm == 3.0


@pytest.mark.slow
def test_the_front_shows_the_word_and_the_back_its_mirror_image() -> None:
    """By where the letters are placed: row 0 at the top, column 0 at the left, the origin in the middle."""
    drawn = pages()
    assert ["".join(row) for row in words(drawn["front"])] == WORD_7
    assert words(drawn["back"]) == [row[::-1] for row in words(drawn["front"])]
    assert body().cell_centre_mm(3, 0) == (-60.0, -60.0)


@pytest.mark.slow
def test_the_rulers_are_true_to_scale(tmp_path: Path) -> None:
    """In the PDF's own units, on A4: rulers of 100 mm."""
    pdf = tmp_path / "panel-7.pdf"
    write_pdf(list(pages().values()), pdf)
    boxes = re.findall(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+) ?\]", pdf.read_bytes())
    assert boxes
    for width, height in boxes:
        assert (float(width), float(height)) == pytest.approx((595.276, 841.890), abs=0.01)
    flat = [x1 - x0 for x0, y0, x1, y1 in pdf_lines_mm(pdf) if y0 == y1]
    assert [round(mm, 3) for mm in flat].count(100.0) == 2  # a ruler on each of the two pages that are 1 : 1


@pytest.mark.slow
def test_the_frame_is_drawn_in_its_size() -> None:
    """180 mm on the page for a lit square of 160 mm, in the page's own coordinates; also where it takes several."""
    for side_mm in (160.0, 400.0):
        for name, page in pages(side_mm).items():
            if not name.startswith(("front", "back")):
                continue
            axes: Axes = page.figure.axes[1]
            left, right = axes.get_xlim()
            bottom, top = axes.get_ylim()
            inches = page.figure.get_size_inches() * [axes.get_position().width, axes.get_position().height]
            assert 25.4 * inches == pytest.approx([right - left, top - bottom])
            outer = axes.patches[0].get_bbox()
            assert (outer.width, outer.height) == pytest.approx((side_mm + 20, side_mm + 20))


@pytest.mark.slow
def test_parts_of_a_large_panel_make_it_up() -> None:
    """Each place of a panel of 40 cm, frame included, is on exactly one page."""
    windows = [page.figure.axes[1] for name, page in pages(400.0).items() if name.startswith("front")]
    assert len(windows) == 6
    rng = np.random.default_rng(0)
    for x, y in rng.uniform(-210, 210, (200, 2)):
        bounds = [(*window.get_xlim(), *window.get_ylim()) for window in windows]
        assert sum(left <= x < right and bottom <= y < top for left, right, bottom, top in bounds) == 1


@pytest.mark.slow
def test_many_panels_of_any_grid() -> None:
    """A PDF for each ID, and each page as SVG."""
    told = run("3", "42", "--out", "sheets", "--set", "panels.dictionary=DICT_5X5_50")
    assert told.split() == ["sheets/panel-3.pdf", "sheets/panel-42.pdf"]
    names = {path.name for path in Path("sheets").iterdir()}
    assert {f"panel-{i}-{p}.svg" for i in (3, 42) for p in ("overview", "circuit", "front", "back")} <= names
    machines = ("front.dxf", "back.dxf", "walls.dxf", "walls.stl")
    assert {f"panel-{i}-{part}" for i in (3, 42) for part in machines} <= names
    svg = Path("sheets/panel-3-back.svg").read_text()
    assert re.search(r'width="595\.27\d*pt" height="841\.8\d*pt"', svg)


@pytest.mark.slow
def test_what_cannot_be_printed_is_refused_and_nothing_written() -> None:
    """Not even for the other IDs; 10 m at 1 : 1 would be 55 × 43 pages."""
    with pytest.raises(ConfigError, match=r"ID 50: DICT_4X4_50 has the IDs 0 to 49"):
        run("7", "50", "--out", "sheets")
    with pytest.raises(ConfigError, match="takes 2365 pages of A4"):
        run("7", "--out", "sheets", "--side", "10")
    assert not Path("sheets").exists()
    note = "ID 3 is reported only if panels.ids lists it: a part or a reflection of a panel can look the same"
    assert run("3", "--out", "sheets").splitlines()[1:] == [note]


@pytest.mark.slow
def test_the_same_panel_gives_the_same_sheet(tmp_path: Path) -> None:
    """No dates in it: a sheet can be kept beside the configuration."""
    one, two = tmp_path / "one", tmp_path / "two"
    for path in (one, two):
        write_pdf([pages()["front"]], path)
    assert one.read_bytes() == two.read_bytes()


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_one_error(tmp_path: Path) -> None:
    """And not what matplotlib makes of it, which was an error of zlib's."""
    with pytest.raises(OSError, match="No space left on device"):
        write_pdf(list(pages().values()), Path("/dev/full"))
