"""Scores: what counts as recognised, what as a false ID, and how sure a rate is."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ledpi.core.records import Floats, Pose, Rejected
from ledpi.pipeline.trace import Dropped
from ledpi.workshop.evaluate.scoring import NOTHING_THERE, Expected, Found, Read, Tally
from ledpi.workshop.evaluate.table import COLUMNS, TableRow, table_row, wilson, write_csv

SQUARE = np.array([[100.0, 50.0], [140.0, 50.0], [140.0, 90.0], [100.0, 90.0]])  # 40 px, clockwise
UPRIGHT = np.array([0.0, 1.0, 0.0, 0.0])  # faces the camera
POSE = Pose(position_m=np.array([0.0, 0.0, 2.0]), quaternion_wxyz=UPRIGHT)
PANEL_7 = Expected(id=7, corners_px=SQUARE, pose=POSE)


def found(marker_id: int = 7, corners_px: Floats = SQUARE, pose: Pose | None = POSE) -> Found:
    return Found(id=marker_id, corners_px=corners_px, pose=pose)


def read(*markers: Found, dropped: tuple[Dropped, ...] = ()) -> Read:
    return Read(found=markers, dropped=dropped, milliseconds=1.5)


def tally_of(what: Read, *expected: Expected) -> Tally:
    tally = Tally(trials=1)
    tally.add(what, expected, "here")
    return tally


# R. G. Newcombe, Statistics in Medicine 17 (1998) 857, table I, method 3.
@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_interval(successes: int, trials: int, low: float, high: float) -> None:
    """As in the literature, to its four digits; and mirrored: all recognised is as sure as none."""
    assert wilson(trials - successes, trials) == pytest.approx((1 - high, 1 - low), abs=5e-5)
    assert wilson(successes, trials) == pytest.approx((low, high), abs=5e-5)


def test_the_right_id_at_the_right_place_is_recognised() -> None:
    """Corners (3, 4) px off are 5 px off in rms; a position 2 cm off at 2 m is off by 1 %; a turn by 60° is one."""
    pose = Pose(
        position_m=np.array([0.0, 0.02, 2.0]),
        quaternion_wxyz=np.array([0.0, np.cos(np.pi / 6), np.sin(np.pi / 6), 0.0]),
    )
    tally = tally_of(read(found(corners_px=SQUARE + np.array([3.0, 4.0]), pose=pose)), PANEL_7)
    assert (tally.expected, tally.recognised, tally.false_ids) == (1, 1, 0)
    assert tally.corner_px == pytest.approx([5.0])
    assert tally.position_percent == pytest.approx([1.0])
    assert tally.angle_deg == pytest.approx([60.0])
    assert tally.decode_ms == [1.5]


@pytest.mark.parametrize(
    "wrong",
    [
        found(8),
        found(corners_px=np.roll(SQUARE, 1, axis=0)),
        found(corners_px=SQUARE + np.array([10.5, 0.0])),
    ],
    ids=["another ID", "turned by a quarter", "more than a quarter of its size away"],
)
def test_anything_else_is_a_false_id_and_a_miss(wrong: Found) -> None:
    """A robot would be led astray by each of these."""
    tally = tally_of(read(wrong), PANEL_7)
    assert (tally.recognised, tally.false_ids) == (0, 1)
    assert tally.false[0].startswith(f"here: ID {wrong.id} at (")
    assert "where 7 is" in tally.false[0]


def test_a_marker_partly_in_view_may_be_read_or_not() -> None:
    """It is neither expected nor false; the same ID reported twice is once right, once false."""
    optional = replace(PANEL_7, optional=True)
    for what in (read(), read(found())):
        tally = tally_of(what, optional)
        assert (tally.expected, tally.recognised, tally.false_ids) == (0, 0, 0)
    tally = tally_of(read(found(), found(corners_px=SQUARE + 200.0)), PANEL_7)
    assert (tally.recognised, tally.false_ids) == (1, 1)


def test_of_real_frames_the_id_alone_is_known() -> None:
    """Wherever it is; there are no errors to tell."""
    tally = tally_of(read(found(corners_px=SQUARE + 77.0), found(8)), Expected(id=7))
    assert (tally.recognised, tally.false_ids) == (1, 1)
    assert tally.corner_px == tally.position_percent == []


def test_why_a_panel_was_missed() -> None:
    """The candidate at its place tells; those elsewhere do not."""
    here = Dropped(corners_px=SQUARE + 4.0, why=Rejected(stage="identify", reason="no_bands"))
    elsewhere = Dropped(corners_px=SQUARE + 90.0, why=Rejected(stage="fit", reason="misfit"))
    assert tally_of(read(dropped=(elsewhere, here)), PANEL_7).missed == {"identify.no_bands": 1}
    assert tally_of(read(dropped=(elsewhere,)), PANEL_7).missed == {NOTHING_THERE: 1}


def test_tallies_add_up_and_survive_json() -> None:
    """Gives for two workers what one would have counted."""
    hit, miss = tally_of(read(found()), PANEL_7), tally_of(read(found(8)), PANEL_7)
    total = Tally.sum_of([hit, Tally.from_json(miss.as_json())])
    assert (total.frames, total.trials, total.expected, total.recognised, total.false_ids) == (2, 2, 2, 1, 1)
    assert total.missed == {NOTHING_THERE: 1}
    assert total.false == miss.false
    assert total.decode_ms == [1.5, 1.5]


def row(tally: Tally) -> TableRow:
    return table_row(
        tally,
        suite="paper",
        case="plain",
        distance_m=0.6,
        angle_deg=0.0,
        exposure_us=150.0,
        transfer="srgb",
        any_roll=True,
        method="likelihood",
    )


def test_columns_of_the_csv(tmp_path: Path) -> None:
    """Named once, in a stable order; what does not exist is empty. 12 frames of one take are no surer than one."""
    path = tmp_path / "results.csv"
    write_csv(path, [row(tally_of(read(found(8)), PANEL_7))])
    with path.open(newline="", encoding="utf-8") as file:
        lines = list(csv.reader(file))
    assert ",".join(lines[0]) == (
        "suite,case,distance_m,angle_deg,exposure_us,transfer,roll,method,frames,trials,expected,recognised,"
        "rate,rate_low,rate_high,false_ids,corner_px,position_percent,angle_error_deg,decode_ms,missed"
    )
    values = dict(zip(COLUMNS, lines[1], strict=True))
    assert (values["rate"], values["false_ids"], values["corner_px"]) == ("0", "1", "")
    assert values["missed"] == f"{NOTHING_THERE}:1"
    assert row(Tally(frames=12, trials=1, expected=12, recognised=12)).rate_low == wilson(1, 1)[0]
