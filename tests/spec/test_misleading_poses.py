"""A pose that a robot gets is not further off than its deviations say, or its alternate is given."""

from __future__ import annotations

import numpy as np
import pytest

from tests.builders.misleading import poses, turning


@pytest.mark.parametrize(
    ("turn_rad_s", "scenes"),
    [
        (0.5, 8),
        *(pytest.param(turn_rad_s, 60, marks=pytest.mark.slow) for turn_rad_s in (0.25, 0.5, 1.0, 2.0)),
    ],
)
def test_a_first_frame_knows_no_motion_and_says_so(turn_rad_s: float, scenes: int) -> None:
    """Before a robot that turns: a squared normalised error in six dimensions has a median below 9, 95 % below 24."""
    nees = [each.nees for seed in range(scenes) for each in poses(turning(seed, turn_rad_s), seed, 1, stream=False)]
    assert len(nees) > scenes / 2
    assert np.median(nees) < 9
    assert np.percentile(nees, 95) < 24
