"""From tallies to rows: rates with their intervals, medians; and results.csv."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from statistics import NormalDist, median
from typing import Any

from ledpi.workshop.evaluate.scoring import Tally

PLAIN = "plain"  # the case in which nothing is wrong with the panel
PAPER_ANGLES_AT_M = 0.6

_Z95 = NormalDist().inv_cdf(0.975)


def wilson(successes: float, trials: int) -> tuple[float, float]:
    """Wilson's 95 % score interval of a rate (Wilson, J. Am. Stat. Assoc. 22, 1927).

    With p = successes/trials, n = trials: (p + z²/2n ± z·√(p(1−p)/n + z²/4n²)) / (1 + z²/n). Raises ValueError for
    no trials.
    """
    if trials < 1:
        raise ValueError("a rate needs at least one trial")
    rate, z2 = successes / trials, _Z95 * _Z95
    middle = rate + z2 / (2 * trials)
    half = _Z95 * math.sqrt(rate * (1 - rate) / trials + z2 / (4 * trials * trials))
    low, high = (middle - half) / (1 + z2 / trials), (middle + half) / (1 + z2 / trials)
    return max(0.0, min(rate, low)), min(1.0, max(rate, high))  # both hold the rate, but for rounding


@dataclass(frozen=True, slots=True, kw_only=True)
class TableRow:
    """One method under one condition. Errors are medians, of what was recognised."""

    suite: str
    case: str
    distance_m: float | None
    angle_deg: float | None
    exposure_us: float
    transfer: str
    roll: str  # any, upright, or empty where it is not known
    method: str
    frames: int
    trials: int
    expected: int
    recognised: int
    rate: float | None  # None where nothing was to be recognised
    rate_low: float | None
    rate_high: float | None
    false_ids: int
    corner_px: float | None
    position_percent: float | None
    angle_error_deg: float | None
    decode_ms: float | None
    missed: tuple[tuple[str, int], ...]  # why, how often; the most frequent first
    false: tuple[str, ...]


def table_row(tally: Tally, *, any_roll: bool | None, **condition: Any) -> TableRow:
    """One of the condition: suite, case, distance_m, angle_deg, exposure_us, transfer and method.

    The interval counts trials, not frames: frames of one take share its place, room and noise of the sensor.
    """
    rate = tally.recognised / tally.expected if tally.expected else None
    low, high = wilson(rate * tally.trials, tally.trials) if rate is not None else (None, None)
    counts = {name: getattr(tally, name) for name in ("frames", "trials", "expected", "recognised", "false_ids")}
    return TableRow(
        **condition,
        **counts,
        roll="" if any_roll is None else "any" if any_roll else "upright",
        rate=rate,
        rate_low=low,
        rate_high=high,
        corner_px=_median(tally.corner_px),
        position_percent=_median(tally.position_percent),
        angle_error_deg=_median(tally.angle_deg),
        decode_ms=_median(tally.decode_ms),
        missed=tuple(sorted(tally.missed.items(), key=lambda item: (-item[1], item[0]))),
        false=tuple(tally.false),
    )


def _median(values: Sequence[float]) -> float | None:
    return median(values) if values else None


COLUMNS = tuple(field.name for field in fields(TableRow) if field.name != "false")


def write_csv(path: Path, rows: Iterable[TableRow]) -> None:
    """One line a row; empty where a value does not exist."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows([_as_text(getattr(row, name)) for name in COLUMNS] for row in rows)


def _as_text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, tuple):
        return " ".join(f"{why}:{count}" for why, count in value)
    return str(value)
