"""`evaluation/results.py`: the page says what was counted, and nothing else."""

from __future__ import annotations

import pytest

from evaluation import ROOT, results
from evaluation.endurance import bridges
from evaluation.speed import arm
from evaluation.speed import panels as contests
from ledpi.workshop.evaluate.scoring import Tally
from ledpi.workshop.evaluate.table import TableRow, table_row


def row(suite: str, case: str, method: str, exposure_us: float = 10_000.0, **counts: object) -> TableRow:
    """Makes that of four takes, three read, each with errors of 0.2 px, 1 % and 2°."""
    values: dict[str, object] = {"frames": 4, "trials": 4, "expected": 4, "recognised": 3, "missed": {}}
    values |= {"corner_px": [0.2], "position_percent": [1.0], "angle_deg": [2.0]}
    tally = Tally.from_json(values | counts)
    return table_row(
        tally,
        suite=suite,
        case=case,
        distance_m=None,
        angle_deg=None,
        exposure_us=exposure_us,
        transfer="any",
        any_roll=True,
        method=method,
    )


WILD = [
    row("wild", "near", "ledpi"),
    row("wild", "near", "oracle", recognised=4),
    row("wild", "near", "aruco", recognised=2, false_ids=1, false=["take 1, frame 0: ID 9"]),
    row("wild", "far", "ledpi", expected=12, recognised=6, false_ids=1, false=["take 3, frame 4: ID 5 at (1, 2) px"]),
    row("wild", "far", "oracle", expected=12, recognised=9),
    row("wild", "far", "aruco", expected=12, recognised=0, corner_px=[]),
]
DECOYS = [
    row("decoys", "dead_cell", "likelihood", 150.0, frames=24),
    row("decoys", "dead_cell", "stream_all", 150.0, frames=24, false_ids=1, false=["take 0, frame 7: ID 17"]),
    row("decoys", "lamps", "likelihood", 150.0, frames=12),
    row("decoys", "lamps", "stream_all", 150.0, frames=12),
]


def test_the_page_says_what_was_read_of_each_row_and_under_which_conditions() -> None:
    """Rates of all three with intervals, false IDs of each, errors of what was read; who ran it, and on what."""
    page = results.page("python -m evaluation.results --takes 4", WILD, DECOYS, "| speed |")
    assert "Written by `python -m evaluation.results --takes 4` at commit" in page
    assert "our own simulator, which draws 4 takes a row" in page
    near, far = (line for line in page.splitlines() if line.startswith(("| near | 0.42", "| far | 3")))
    rates = ["3 of 4: 75% (30 to 95)", "4 of 4: 100% (51 to 100)", "2 of 4: 50% (15 to 85)"]
    assert near.split(" | ") == ["| near", "0.42 to 1.4 m", "0 to 50°", "10 ms", "1", *rates, "0, 0, 1 |"]
    assert "| 4 to 6 | 6 of 12: 50% (15 to 85) |" in far
    assert "| far | 0.2 px, 1 %, 2° | – |" in page
    assert "\n\n| speed |\n\n" in page
    assert page.endswith(f"\n\n{arm.counts_table(arm.kept())}\n")


def test_each_false_id_is_listed_and_decoys_add_up() -> None:
    """Ours alone, with the take and the frame that show it."""
    page = results.page("", WILD, DECOYS, "")
    listed = [line for line in page.splitlines() if line.startswith("* ") and ": take" in line]
    assert listed == [
        "* far, 10 ms, ledpi: take 3, frame 4: ID 5 at (1, 2) px",
        "* dead cell, 0.15 ms, stream: take 0, frame 7: ID 17",
    ]
    assert "| dead cell | 0.15 ms | 24 | 0 | 1 |" in page
    assert "| all |  | 36 | 0 | 1 |" in page
    assert "False IDs:\n\nNone." in results.page("", WILD, DECOYS[2:], "")


@pytest.mark.parametrize("count", [1, 8])
def test_panels_of_the_contest_exist(count: int) -> None:
    """Excludes one that is never reported, of which only the time would count."""
    shown = [panel.marker_id for panel in contests.scene_of(count).panels]
    assert len(set(shown)) == count
    assert set(shown) <= contests.SETTINGS.existing_ids()


def test_the_page_has_the_bridges_figures_as_they_were_kept() -> None:
    """Both kinds of far end, for ten minutes."""
    figures = bridges.kept()
    assert [(one.kind, one.minutes) for one in figures] == [("mqtt", 10.0), ("nt", 10.0)]
    assert bridges.figures_table(figures) in (ROOT / "docs/results.md").read_text(encoding="utf-8")
    assert results.BRIDGES in (ROOT / "docs/results.md").read_text(encoding="utf-8")
