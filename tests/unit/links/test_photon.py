"""A frame in PhotonLib's packet: the bytes that photonlibpy 2026.3.4 itself packs of the same target."""

from __future__ import annotations

import json
import struct
import subprocess
import threading
from pathlib import Path

import numpy as np
import pytest

from ledpi.config.outputs import OutputSettings
from ledpi.links.photon import MESSAGE, mount_of, packet
from tests.builders.bridges import free_port, is_open
from tests.builders.environments import environment, installer, run
from tests.builders.made_up_daemon import HELLO, PANEL, decoded
from tests.builders.waiting import wait_until

# One target, ID 7, 2 m ahead and facing the camera, or turned by 106°; times 1000 and 31000 µs.
PACKED = bytes.fromhex(
    "0300000000000000e803000000000000187900000000000000000000000000000100000000000000000000000000000000abaaaaaaaa0a"
    "2a40000000000000000007000000ffffffff000080bf000000000000004000000000000000000000000000000000000000000000000000"
    "000000000000000000000000000000000000000000f03f000000000000004000000000000000000000000000000000333333333333e33f"
    "000000000000000000000000000000009a9999999999e93f000000000000d03f0400000000000024400000000000003e40000000000000"
    "3e400000000000003e400000000000003e4000000000000024400000000000002440000000000000244004000000000000244000000000"
    "00003e400000000000003e400000000000003e400000000000003e4000000000000024400000000000002440000000000000244000"
)
# The camera at 1, 1.8, 0.3 m, turned by 73.7° to the left, by panels 7 and 11 with an error of 0.2 px.
MULTI_TAG = bytes.fromhex(
    "000000000000f03fcdccccccccccfc3f333333333333d33f9a9999999999e93f00000000000000000000000000000000333333333333e33f"
    "000000000000f03fcdccccccccccfc3f333333333333d33f9a9999999999e93f00000000000000000000000000000000333333333333e33f"
    "9a9999999999c93f9a9999999999c93f00000000000000000207000b00"
)
FIX = struct.Struct("<7d7d3d")
ROBOT = {"position_m": [1.0, 2.0, 0.0], "quaternion_wxyz": [0.8, 0.0, 0.0, 0.6], "panels_used": [7, 11]}
MOUNT = {"camera_mount": {"position_m": [-0.192, -0.056, 0.3], "rpy_deg": [0.0, 0.0, 0.0]}}
PROGRAM = """
import json, sys, time
import ntcore
from photonlibpy import photonCamera
ntcore.NetworkTableInstance.getDefault().startServer("", "127.0.0.1", 0, int(sys.argv[1]))
camera = photonCamera.PhotonCamera("ledpi")
print(flush=True)
while not camera.getAllUnreadResults():
    time.sleep(0.01)
photonCamera._lastVersionTimeCheck = -10.0  # it looks for mistakes each 5 s: now
result = camera.getLatestResult()
place = result.multitagResult.estimatedPose.best.translation()
print(json.dumps([result.multitagResult.fiducialIDsUsed, place.x, place.y, place.z]), flush=True)
sys.stdin.read()
"""
HEAD = struct.Struct("<4qB4d2if7d7dd")  # up to the corners
MIRRORED = {"position_m": [0.0, 0.0, 2.0], "quaternion_wxyz": [0.0, 0.8, 0.0, -0.6], "reprojection_px": 0.4}


def test_a_packet_is_photonlibs() -> None:
    """Number by number (a zero may be negative), and the corners to the byte."""
    frame = decoded(3) | {"markers": [PANEL | {"reprojection_px": 0.1, "alternate": MIRRORED}]}
    made = packet(frame, (64, 48), captured_us=1000, published_us=31000)
    assert HEAD.unpack_from(made) == HEAD.unpack_from(PACKED)
    assert made[HEAD.size :] == PACKED[HEAD.size :]


def test_a_panel_without_a_pose_is_no_target() -> None:
    """PhotonLib knows no other."""
    frame = decoded(3) | {"markers": [PANEL | {"position_m": None, "quaternion_wxyz": None}]}
    made = packet(frame, (64, 48), captured_us=1000, published_us=31000)
    assert made[32:] == bytes([0, 0])


def test_the_topic_says_which_message_it_holds(capfd: pytest.CaptureFixture[str]) -> None:
    """PhotonLib asks for it every 5 s; ntcore has nothing to warn of."""
    ntcore = pytest.importorskip("ntcore")
    from ledpi.links.nt import publish_photon

    instance = ntcore.NetworkTableInstance.create()
    topic = instance.getRawTopic("/photonvision/ledpi/rawBytes")
    publisher = publish_photon(topic, ntcore.PubSubOptions())
    assert topic.getProperty("message_uuid") == MESSAGE
    publisher.close()
    ntcore.NetworkTableInstance.destroy(instance)
    assert capfd.readouterr().err == ""


def test_several_panels_of_a_map_are_a_multi_tag_result() -> None:
    """The camera has its place on the field, from which a robot program has its own; by one panel there is none."""
    frame = decoded(3) | {"markers": [PANEL | {"reprojection_px": 0.2}], "robot": ROBOT}
    mount = mount_of(MOUNT)
    assert mount_of({"camera_mount": {"position_m": [-0.192, -0.056, 0.3]}}).tolist() == mount.tolist()
    assert mount_of({"camera_mount": None}).tolist() == np.eye(4).tolist()
    made = packet(frame, (64, 48), 1000, 31000, mount)
    alone = packet(frame | {"robot": ROBOT | {"panels_used": [7]}}, (64, 48), 1000, 31000, mount)
    there, result = made[len(alone) - 1], made[len(alone) :]
    assert (alone[-1], there) == (0, 1)
    assert FIX.unpack_from(result) == pytest.approx(FIX.unpack_from(MULTI_TAG))
    assert result[FIX.size :] == MULTI_TAG[FIX.size :]


@pytest.mark.slow
def test_photonlib_takes_it_and_warns_of_nothing(tmp_path: Path) -> None:
    """The robot program's own library, which looks for the version and the camera; nor does ntcore."""
    programs = environment(tmp_path / "robot")
    run(*installer(programs), "photonlibpy==2026.3.4")
    from ledpi.links.nt import NtTarget

    port = free_port()
    command = [programs / "python", "-c", PROGRAM, str(port)]
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen(command, text=True, **pipes) as program:
        assert program.stdout is not None
        program.stdout.readline()
        target = NtTarget(OutputSettings(kind="nt", host="127.0.0.1", port=port, photon_camera="ledpi"))
        wait_until(lambda: is_open(target))
        target.tell_setup(HELLO | MOUNT)
        said = threading.Thread(target=lambda: lines.append(program.stdout.readline()))  # type: ignore[union-attr]
        lines: list[str] = []
        said.start()
        while said.is_alive():
            frame = decoded(3)
            target.send(frame | {"robot": ROBOT | {"exposed_ns": frame["exposed_ns"]}}, frame["exposed_ns"])
            said.join(0.02)
        _, warned = program.communicate()
        target.close()
    assert json.loads(lines[0]) == [[7, 11], *map(pytest.approx, (1.0, 1.8, 0.3))]
    assert warned == ""
