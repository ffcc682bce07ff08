"""From rendered frames and a map to the robot's place: in `ledpi decode`'s output, and on the serial line."""

from __future__ import annotations

import json
import os
import threading
import tty
from pathlib import Path

import numpy as np
import pytest

from ledpi.camera.recording.writer import RecordingWriter
from ledpi.camera.simulate.scene import SimulatedSensor
from ledpi.camera.simulate.scenes import ov5647_lens, still_scene, whole_rows_us
from ledpi.camera.simulated import SimulatedCamera
from ledpi.core.records import PanelSpec
from ledpi.wire import FixMessage, NoFix, Receiver, StatusMessage
from tests.builders.command import ledpi

SPEC = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
FRAMES = 8
# Panels 7, 23 and 12 stand 24 cm apart, 0.9 m ahead of the camera, which is the robot's origin; 12 is not in the map.
MAP = """
deviations: {position_m: 0.003, angle_deg: 0.5}
panels:
  7: {position_m: [0.9, 0.24, 0], yaw_deg: 180}
  23: {position_m: [0.9, 0, 0], yaw_deg: 180}
"""


@pytest.fixture(scope="module")
def take(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("take")
    sensor = SimulatedSensor(intrinsics=ov5647_lens(), exposure_us=whole_rows_us(10000, 33.67), row_time_us=33.67)
    scene = still_scene(sensor, dict.fromkeys((7, 23, 12), SPEC), "DICT_4X4_50", distance_m=0.9, angle_deg=0)
    camera = SimulatedCamera(scene, seed=4, paced=False, frames=FRAMES)
    pixels = np.empty((480, 640), np.uint8)
    with RecordingWriter(folder / "rec", camera=camera.info, dictionary="DICT_4X4_50", panel=SPEC, note="") as writer:
        while (frame := camera.read(pixels)) is not None:
            writer.write(frame, camera.truth(frame.seq))
    (folder / "markers.yaml").write_text(MAP)
    return folder


@pytest.mark.slow
def test_decode_tells_where_the_robot_is(take: Path) -> None:
    """At the map's origin, to 1 cm and within what it says of itself; from the panels of the map."""
    done = ledpi("decode", "--set", "map=markers.yaml", "rec", cwd=take)
    assert done.returncode == 0, done.stderr
    last = json.loads(done.stdout.splitlines()[-1])
    assert {marker["id"] for marker in last["markers"]} == {7, 12, 23}
    robot = last["robot"]
    assert robot["panels_used"] == [7, 23]
    assert robot["panels_rejected"] == []
    assert np.linalg.norm(robot["position_m"]) < 0.01
    assert abs(robot["quaternion_wxyz"][0]) > 0.9999
    deviations = np.sqrt(np.diag(np.reshape(robot["covariance"], (6, 6))))
    assert (np.abs(robot["position_m"]) < 3 * deviations[:3]).all()
    assert (deviations[:3] < 0.05).all()


@pytest.mark.slow
def test_the_line_carries_the_fix(take: Path) -> None:
    """`ledpi run`: fixes with deviations, two panels in each, and a status that says that there is one."""
    master, slave = os.openpty()
    tty.setraw(master)
    received = bytearray()

    def read() -> None:
        try:
            while data := os.read(master, 65536):
                received.extend(data)
        except OSError:
            pass

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    settings = ["camera.source=recording:rec", "map=markers.yaml"]
    settings += [f"serial.port={os.ttyname(slave)}", "serial.max_age_ms=5000"]  # a busy machine may be late
    done = ledpi("run", "--unpaced", *(part for item in settings for part in ("--set", item)), cwd=take)
    os.close(slave)
    reader.join(2.0)
    os.close(master)
    assert done.returncode == 0, done.stderr
    messages = Receiver().feed(bytes(received))
    fixes = [message for message in messages if isinstance(message, FixMessage)]
    assert fixes, (messages, done.stderr)
    assert {fix.panels_used for fix in fixes} <= {1, 2}  # a search is told of as it goes on: one panel after the other
    assert [fix.panels_used for fix in fixes].count(2) >= len(fixes) - 2
    for fix in fixes:
        assert np.linalg.norm(fix.pose.position_m) < 0.02
        assert fix.pose.deviation_m is not None
        assert 0 < max(fix.pose.deviation_m) < 0.05
    said = {message.no_fix for message in messages if isinstance(message, StatusMessage)}
    assert said <= {NoFix.NONE, NoFix.NOT_RUNNING, NoFix.STALE, NoFix.NO_PANEL, NoFix.NO_FRAMES, NoFix.BEHIND}
