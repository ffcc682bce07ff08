"""The state on NetworkTables: what a robot program that subscribes gets."""

from __future__ import annotations

import struct
import time

import numpy as np
import pytest

from ledpi.config.outputs import OutputSettings
from tests.builders.bridges import free_port, is_open
from tests.builders.waiting import wait_until

COVARIANCE = np.diag([0.0001, 0.0004, 0.0009]).ravel().tolist()


def test_the_state_is_a_pose_of_wpilib_and_as_old_as_it_says() -> None:
    """x, y and yaw as the struct Pose2d, deviations by hand; with no state nothing but that."""
    ntcore = pytest.importorskip("ntcore", reason="pyntcore is not installed (no wheel for this Python or machine)")
    from ledpi.links.nt import NtTarget

    port, server = free_port(), ntcore.NetworkTableInstance.create()
    server.startServer("", "127.0.0.1", 0, port)
    table = "/ledpi/robot_state"
    pose = server.getRawTopic(f"{table}/pose").subscribe("struct:Pose2d", b"")
    deviations, mode = (
        server.getDoubleArrayTopic(f"{table}/std_devs").subscribe([]),
        server.getStringTopic(f"{table}/mode").subscribe(""),
    )
    target = NtTarget(OutputSettings(kind="nt", host="127.0.0.1", port=port))
    wait_until(lambda: is_open(target))
    now_ns = time.monotonic_ns()
    state = {"t_ns": now_ns - 40_000_000, "mode": "odometry", "position_m": [1.0, -2.0], "yaw_rad": 0.5}
    target.send_robot(state | {"covariance": COVARIANCE}, now_ns)
    wait_until(lambda: mode.get() == "odometry")
    assert struct.unpack("<3d", pose.get()) == (1.0, -2.0, 0.5)
    assert deviations.get() == pytest.approx([0.01, 0.02, 0.03])
    assert ntcore._now() - pose.getLastChange() >= 40_000  # µs
    nothing = dict.fromkeys(("position_m", "yaw_rad", "covariance"))
    target.send_robot(nothing | {"t_ns": now_ns, "mode": "none"}, now_ns)
    wait_until(lambda: mode.get() == "none")
    target.close()
    ntcore.NetworkTableInstance.destroy(server)
