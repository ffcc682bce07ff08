"""Runs `table.md`: what is read of painted frames, from the picture to the ID and the corners."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np
import pytest

from ledpi.core.records import Decoded
from ledpi.pipeline.pipeline import Pipeline
from tests.builders import ROOT
from tests.builders.decode import camera_info, panel_settings
from tests.scenarios.conditions import CONDITIONS, FOCAL_PX, SIDE_M, Condition, frames

TABLE = ROOT / "tests/scenarios/table.md"


@dataclass(frozen=True)
class Scenario:
    """One cell of the table."""

    name: str
    exposure_us: float
    distance_m: float
    frames: int
    stream: bool
    read_from: int | None  # frame, counted from 1; None: never
    off_px: float | None  # allowed to the farthest corner; None: not asked

    @property
    def condition(self) -> Condition:
        return CONDITIONS[self.name]

    def __str__(self) -> str:
        return f"{self.name}-{self.exposure_us:g}us-{self.distance_m:g}m-{self.frames}{'s' if self.stream else 'a'}"


def scenarios() -> list[Scenario]:
    """The whole table."""
    lines = TABLE.read_text(encoding="utf-8").splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")][2:]
    return [
        Scenario(
            name=name,
            exposure_us=exposure_us,
            distance_m=distance_m,
            frames=int(shown.split()[0]),
            stream={"stream": True, "alone": False}[shown.split()[1]],
            read_from=None if since == "never" else int(since),
            off_px=allowed_px(corners, distance_m) if corners else None,
        )
        for name, exposures, distances, shown, since, corners in rows
        for exposure_us, distance_m in product(map(float, exposures.split()), map(float, distances.split()))
    ]


def allowed_px(text: str, distance_m: float) -> float:
    number, unit = text.split()
    return float(number) * {"px": 1.0, "%": FOCAL_PX * SIDE_M / distance_m / 100}[unit]


@cache
def decoded(scenario: Scenario) -> tuple[Decoded, ...]:
    """Returns what a new pipeline makes of each frame."""
    camera = camera_info(exposure_us=scenario.exposure_us)
    lens, stream = scenario.condition.lens, scenario.stream
    path = Pipeline(camera, panel_settings(), intrinsics=lens, stream=stream)
    shown = frames(scenario.name, scenario.exposure_us, scenario.distance_m, scenario.frames, stream)
    return tuple(path.decode(frame) for frame in shown)


def ids(found: Decoded) -> tuple[int, ...]:
    return tuple(sorted(marker.detection.id for marker in found.markers))


SCENARIOS = scenarios()


@pytest.mark.parametrize("scenario", SCENARIOS, ids=str)
def test_what_is_shown_is_read(scenario: Scenario) -> None:
    """From the frame on that the table says, in each; and no other ID in any frame."""
    shown = [scenario.condition.shown(n) for n in range(scenario.frames)]
    read = [ids(found) for found in decoded(scenario)]
    surely = scenario.frames if scenario.read_from is None else scenario.read_from - 1
    assert read[surely:] == shown[surely:]
    assert [extra for frame, true in zip(read, shown, strict=True) for extra in frame if extra not in true] == []


@pytest.mark.parametrize("scenario", [each for each in SCENARIOS if each.off_px is not None], ids=str)
def test_corners_are_where_they_were_painted(scenario: Scenario) -> None:
    """In the panel's own order."""
    last = scenario.frames - 1
    (marker,) = decoded(scenario)[last].markers
    true = scenario.condition.corners(scenario.distance_m, last)
    assert scenario.off_px is not None
    assert np.linalg.norm(marker.detection.corners_px - true, axis=1).max() < scenario.off_px


def test_every_condition_is_in_the_table() -> None:
    """And no row is there twice."""
    assert {scenario.name for scenario in SCENARIOS} == set(CONDITIONS)
    assert len(set(SCENARIOS)) == len(SCENARIOS) > 90
