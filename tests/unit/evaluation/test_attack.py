"""`evaluation/endurance/attack.py`: that it attacks, and that it would tell what it finds."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from evaluation.endurance import attack
from evaluation.endurance.hostile import check_numbers
from evaluation.endurance.hostile_pictures import KINDS, Drawing, Rng
from ledpi.pipeline.pipeline import Pipeline
from tests.builders.decode import (
    FRAME_ROWS,
    PINHOLE,
    ROW_TIME_US,
    SHORT_US,
    TRUE_10_MS_US,
    Canvas,
    camera_info,
    panel_settings,
    square,
    word,
)
from tests.builders.wire import decoded, marker_pose

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="not installed: gcc")


@pytest.mark.slow
@needs_gcc
def test_an_attack_does_not_begin_where_nothing_is_seen(tmp_path: Path) -> None:
    """Python takes the core that is installed here, which is not watched."""
    with pytest.raises(RuntimeError, match="do not see"):
        attack.check_it_sees(attack.environment(tmp_path))


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_each_kind_of_picture_shows_something(kind: Callable[[Drawing, Rng], None]) -> None:
    """Has finite light, in a picture of any size; most of the time, as some of it may lie outside."""
    lit = 0
    for seed in range(10):
        drawing = Drawing(64, 48, "DICT_4X4_50")
        kind(drawing, np.random.default_rng(seed))
        assert drawing.light.shape == (3, 48, 64)
        assert np.isfinite(drawing.light).all()
        lit += bool(drawing.light.any())
    assert lit >= 6


def test_a_place_that_is_no_number_is_reported() -> None:
    """Looks at what a decoder says, too."""
    pose = marker_pose(7, 0)
    check_numbers(decoded(pose))
    assert pose.solution is not None
    pose.solution.camera_from_marker.position_m[1] = np.nan
    with pytest.raises(ValueError, match="nan"):
        check_numbers(decoded(pose))


@pytest.mark.parametrize("exposure_us", [TRUE_10_MS_US, 600.0, SHORT_US])
def test_a_panel_is_followed_out_of_the_picture(exposure_us: float) -> None:
    """Until nothing is left of it: OpenCV once threw at a window without pixels, and numpy warned of no numbers."""
    path = Pipeline(camera_info(exposure_us=exposure_us), panel_settings(), intrinsics=PINHOLE)
    read = []
    for seq in range(8):
        canvas = Canvas(exposure_us=exposure_us)
        canvas.panel(square(560.3 + 18 * seq, 240.6, 90, 4), word(7), start_us=seq * FRAME_ROWS * ROW_TIME_US)
        told = path.decode(canvas.frame(seq, seq=seq))
        check_numbers(told)
        read.append(len(told.markers))
    assert (read[0], read[-1]) == (1, 0)
