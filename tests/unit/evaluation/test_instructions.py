"""`evaluation/speed/instructions.py`: that it sees what has grown; .ci/run has it count."""

from __future__ import annotations

import json

import pytest

from evaluation.speed.instructions import FIGURES, OURS, grown

BEFORE = {"searched": 20_000, "followed": 3_000}


@pytest.mark.parametrize(
    ("searched", "followed", "expected"),
    [(20_000, 3_000, []), (21_900, 3_290, []), (22_100, 3_000, ["searched"]), (10_000, 3_400, ["followed"])],
)
def test_what_takes_a_tenth_more_than_before_is_named(searched: int, followed: int, expected: list[str]) -> None:
    """Either kind; less is no fault."""
    assert grown({"searched": searched, "followed": followed}, BEFORE) == expected


def test_figures_are_kept_of_both_kinds() -> None:
    """Keeps millions of instructions a frame."""
    kept = json.loads(FIGURES.read_text(encoding="utf-8"))
    assert set(kept) == set(OURS)
    assert all(1_000 < thousands < 1_000_000 for thousands in kept.values())
