"""`ledpi snapshot --map`: panels from above, and the robot's arrow and ellipse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.patches import Ellipse, Polygon

from ledpi.page.panels import SIGMAS, robot_of_state
from ledpi.workshop.plan import draw_robot, plan_of
from tests.builders.command import Run, complaint
from tests.builders.state import room


def test_the_arrow_points_ahead_and_the_ellipse_holds_three_deviations() -> None:
    """At x 1, y 2, with 20 cm along y and 10 cm along x, facing y."""
    state = {"t_ns": 0, "panel_ns": 0, "way_m": 0.0, "mode": "odometry", "contested": False, "moved": []}
    where = {"position_m": [1.0, 2.0], "yaw_rad": np.pi / 2, "covariance": [0.01, 0, 0, 0, 0.04, 0, 0, 0, 0.01]}
    axes = plan_of(room())
    draw_robot(axes, robot_of_state(state | where), SIGMAS)
    (ellipse,) = (patch for patch in axes.patches if isinstance(patch, Ellipse) and patch.width != patch.height)
    assert (ellipse.center, ellipse.width, ellipse.height) == ((1.0, 2.0), pytest.approx(1.2), pytest.approx(0.6))
    assert abs(ellipse.angle) == pytest.approx(90, abs=0.1)
    (arrow,) = (patch for patch in axes.patches if isinstance(patch, Polygon))
    tip = arrow.get_xy()[0] - (1.0, 2.0)
    assert tip[0] == pytest.approx(0)
    assert tip[1] > 0


@pytest.mark.slow
def test_a_recording_says_where_the_robot_is(ledpi: Run, tmp_path: Path) -> None:
    """A metre before panel 7, which is a metre ahead of the map's origin. Without a take the daemon is asked."""
    (tmp_path / "markers.yaml").write_text("panels: {7: {position_m: [1, 0, 1], yaw_deg: 180}}")
    (tmp_path / "config.yaml").write_text("panels: {side_m: 0.16}\nmap: markers.yaml\n")
    assert ledpi("simulate", "a$x_^$", "--frames", 3)[0] == 0
    status, output, errors = ledpi("snapshot", "a$x_^$", "--map", "--out", "plan.jpg")
    assert (status, errors) == (0, "")
    assert output.startswith("plan.jpg: a$x_^$, frame 2: robot at ")
    x, y = (float(word) for word in output.split("robot at ")[1].split()[:2])
    assert (x, y) == (pytest.approx(0, abs=0.02), pytest.approx(0, abs=0.02))
    assert "by panel 7" in output
    assert (tmp_path / "plan.jpg").read_bytes().startswith(b"\xff\xd8")
    assert "map is not set" in complaint(ledpi("snapshot", "a$x_^$", "--map", "--set", "map=null"))
    assert "no frame 9" in complaint(ledpi("snapshot", "a$x_^$", "--map", "--frame", 9))
