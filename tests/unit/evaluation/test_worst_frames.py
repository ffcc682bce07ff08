"""`evaluation/speed/worst_frames.py`: that it sees what is late, and what is read."""

from __future__ import annotations

import argparse

import numpy as np
import pytest

from evaluation.endurance.hostile_pictures import Drawing
from evaluation.speed import worst_frames as bench
from evaluation.speed.worst_frames import Contest, Run


def contest(slower: float = 0.01) -> Contest:
    """A camera of 640 × 480 at 600 µs, for a second; by default on a processor that is never late."""
    return Contest((640, 480), 600.0, "4X4_50", argparse.Namespace(seconds=1.0, slower=slower, draw=0))


def alone(drawing: Drawing) -> None:
    """Nothing beside the panels."""


@pytest.mark.slow
def test_where_nothing_is_late_every_frame_has_a_pose_and_the_second_panel_comes_at_once() -> None:
    """59 frames in a second."""
    told = contest().run(alone)
    assert len(told.took_ms) >= 58
    assert told.poses == len(told.took_ms)
    assert told.second_read is not None
    assert told.second_read < 6
    assert told.longest_periods < 1


def test_who_is_slow_decodes_fewer_frames_and_the_newest_ones() -> None:
    """Leaves out those that come while one takes periods on end; no time is lost between two."""
    told = contest(slower=20.0).run(alone)
    assert len(told.took_ms) < 30
    assert told.longest_periods > 2
    assert told.ended_ms >= sum(told.took_ms)
    assert told.poses_a_second < 30


def test_how_often_the_watchdog_is_fed() -> None:
    """Each 1.67 s, when the tick comes, and 0.4 s later where nothing is known meanwhile."""
    told = Run(period_ms=17.0, progress_ms=[0.0, 17.0, 417.0, 430.0])
    assert told.fed_each_s == pytest.approx(10 / 6 + 0.1 + 0.4)


def test_what_misses_an_aim_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """By its name, one for each."""
    runs = iter(
        [
            Run(period_ms=20.0, took_ms=[1.0, 1.0], poses=50, ended_ms=1000.0),
            Run(period_ms=20.0, took_ms=[29.0, 31.0], poses=44, ended_ms=1000.0, second_read=50, progress_ms=[0, 300]),
        ]
    )
    monkeypatch.setattr(Contest, "run", lambda contest, draw: next(runs))
    line, missed = contest().beside(bench.squares)
    assert line.startswith("44.0 poses/s,  88 % of 50.0; periods of 20.0 ms: first  1.4, longest  1.6; second panel ")
    assert missed == ["share", "longest", "watchdog"]


def test_scenes_are_around_the_panels_and_not_in_them() -> None:
    """The first frame shows the panel's cells and the dark around them, whatever else is drawn."""
    one = contest()
    seen = [
        bench.Scenery(one.camera, one.panels, lambda d, scene=scene: scene(d, np.random.default_rng(0)), 0).frame(16)
        for scene in (bench.squares, bench.noise)
    ]
    at = bench.corners(one.camera.width, one.camera.height, bench.FIRST)
    (left, top), (right, bottom) = at.min(axis=0).astype(int) + 8, at.max(axis=0).astype(int) - 8
    apart = np.abs(seen[0].pixels.astype(int) - seen[1].pixels)
    assert apart[top:bottom, left:right].max() < 9
    assert apart.max() > 100
