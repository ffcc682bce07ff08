"""A program that marks stretches of itself (evaluation/speed/counting.py), and what must be counted of it."""

from __future__ import annotations

# Marks two stretches, the second ten times as long, and none of what is before, between and after.
PROGRAM = """
from evaluation.speed.counting import mark
def count(steps):
    for _ in range(steps):
        pass
count(30_000)
for steps in (10_000, 100_000):
    mark()
    count(steps)
    mark()
    count(50_000)
"""


def check_counted(counts: list[int]) -> None:
    """A step of that loop takes Python tens to hundreds of instructions."""
    short, long = counts
    assert 10 * 10_000 < short < 1_000 * 10_000
    assert 8 * short < long < 12 * short
