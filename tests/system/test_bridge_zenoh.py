"""A daemon's poses in ROS 2, without ROS: participants that know only rmw_zenoh's names and ROS 2's IDL."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("zenoh", reason="eclipse-zenoh is not installed")
pytest.importorskip("rosbags", reason="rosbags is not installed")

from tests.builders import ROOT
from tests.builders.bridges import ZENOH_ROUTER, Zenoh, bridge, free_port
from tests.builders.made_up_daemon import MadeUpDaemon
from tests.builders.ros_node import DETECTIONS, FRAME_US, PANELS, Drive, driven, near
from tests.builders.waiting import limit_s, wait_until

# A router, and a node that subscribes to all that it is told of by liveliness tokens, as ROS 2's tools do.
PARTICIPANT = (
    ZENOH_ROUTER
    + """
subscribers = {}


def text(values):
    return {key: text(value) for key, value in vars(values).items() if key != "__msgtype__"} if hasattr(
        values, "__msgtype__") else [text(value) for value in values] if isinstance(values, list) else (
        values.tolist() if hasattr(values, "tolist") else values)


def meet(sample):
    parts = str(sample.key_expr).split("/")
    if parts[5] != "MP" or sample.kind != zenoh.SampleKind.PUT:
        return
    _, domain, _, _, _, _, enclave, namespace, node, topic, kind, its_hash, qos = parts
    topic, name = topic.replace("%", "/"), kind.replace("::dds_::", "::").replace("::", "/").rstrip("_")
    if name not in types.fielddefs or topic in subscribers:
        return
    assert types.hash_rihs01(name) == its_hash, name

    def hear(sample):
        message = text(types.deserialize_cdr(bytes(sample.payload), name))
        line = json.dumps({"topic": topic, "type": name, "node": f"{namespace}/{node}", "message": message})
        sys.stdout.write(line + "\\n")  # at once: each topic has a thread of its own
        sys.stdout.flush()

    subscribers[topic] = session.declare_subscriber(f"{domain}{topic}/{kind}/{its_hash}", hear)


tokens = session.liveliness().declare_subscriber("@ros2_lv/0/**", meet, history=True)
print("ready", flush=True)
time.sleep(1e6)
"""
)


@pytest.mark.slow
def test_a_tool_finds_every_topic_by_what_the_bridge_tells_of_itself(tmp_path: Path) -> None:
    """As `ros2 topic list` does: by liveliness tokens, with ROS 2's own types, their hashes and the node's name."""
    port, own = free_port(), {"/robot1/ledpi/panel_7", "/robot1/detected_dock_pose"}
    wanted = {*own, "/tf", "/diagnostics"}
    command = [sys.executable, "-c", PARTICIPANT, str(port)]
    participant = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert participant.stdout is not None
    assert participant.stdout.readline() == "ready\n"
    heard: list[dict[str, Any]] = []
    reader = threading.Thread(target=lambda lines: heard.extend(map(json.loads, lines)), args=(participant.stdout,))
    reader.start()
    daemon_end = MadeUpDaemon(tmp_path / "tap.sock", numbered=True)
    try:
        settings = {"kind": "zenoh", "host": "127.0.0.1", "port": port, "topic": "robot1/ledpi"}
        settings |= {"dock_id": 7, "frame_prefix": "front_"}
        with bridge(settings, tmp_path / "tap.sock", tmp_path):
            wait_until(lambda: wanted <= {each["topic"] for each in list(heard)})
    finally:
        daemon_end.close()
        participant.kill()
        reader.join()
        participant.stdout.close()
        participant.wait()
    assert {each["node"] for each in heard} == {"%robot1/ledpi"}
    last = [each["message"] for each in heard if each["topic"] == "/tf"][-1]
    assert [transform["child_frame_id"] for transform in last["transforms"]] == ["front_panel_7"]


@pytest.fixture(
    scope="module",
    params=[pytest.param(5, id="5 s"), pytest.param(30, id="30 s", marks=pytest.mark.nightly)],
)
def drive(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Drive:
    """A robot's, up to two panels of a map and back, at 59 frames a second."""
    frames = round(request.param * 1e6 / FRAME_US)
    return driven(tmp_path_factory.mktemp("drive"), frames, of_recording=min(frames, 588))


@pytest.mark.slow
def test_a_node_hears_of_each_frame_that_the_bridge_has_sent(drive: Drive) -> None:
    """None is lost on the way; what is not sent, as newer ones came before its turn, is counted."""
    counters, first = drive.counters, drive.reached[0]["seq"]  # before it, the bridge had not yet found the daemon
    assert len(drive.heard[DETECTIONS]) == counters["sent"]
    assert counters["refused"] == counters["stale"] == counters["absent"] == 0
    told = [line for line in drive.told if line["seq"] >= first]
    assert len(told) - len(drive.reached) <= counters["missed"] + counters["replaced"]
    assert len(drive.reached) > len(told) / 2


@pytest.mark.slow
@pytest.mark.parametrize("topic", [*PANELS, "/ledpi/pose"])
def test_a_node_hears_every_pose_with_its_covariance(drive: Drive, topic: str) -> None:
    """One for each frame that was sent; equal to the tap's."""
    messages = drive.messages(topic)
    stamps = [stamp_ns(message.header) for message in messages]
    assert stamps == sorted(stamps)
    told = [pose for line in drive.reached for pose in certain_poses(line, topic)]
    assert len(told) > len(drive.reached) / 4
    for pose in told:
        place = near(stamps, drive.unix_ns(pose))
        assert place is not None, f"frame at {pose['exposed_ns']} ns"
        got = messages[place].pose
        assert_pose(got.pose.position, got.pose.orientation, pose)
        np.testing.assert_allclose(got.covariance, pose["covariance"], rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("topic", PANELS)
def test_a_node_hears_of_every_pose_in_tf(drive: Drive, topic: str) -> None:
    """The same, from the camera's optical frame to the panel's."""
    child = topic.rpartition("/")[2]
    transforms = [each for message in drive.messages("/tf") for each in message.transforms]
    transforms = [each for each in transforms if each.child_frame_id == child]
    stamps = [stamp_ns(each.header) for each in transforms]
    assert {each.header.frame_id for each in transforms} == {"camera_optical_frame"}
    for pose in (pose for line in drive.reached for pose in certain_poses(line, topic)):
        place = near(stamps, drive.unix_ns(pose))
        assert place is not None, f"frame at {pose['exposed_ns']} ns"
        assert_pose(transforms[place].transform.translation, transforms[place].transform.rotation, pose)


def certain_poses(line: dict[str, Any], topic: str) -> list[dict[str, Any]]:
    """The pose of a frame that belongs to a topic, if there is one that cannot be its mirror image."""
    if topic == "/ledpi/pose":
        return [line["robot"]] if line["robot"] is not None else []
    markers = [marker for marker in line["markers"] if topic == f"/ledpi/panel_{marker['id']}"]
    return [marker for marker in markers if marker["position_m"] is not None and marker["alternate"] is None]


def stamp_ns(header: Any) -> int:
    """Unix time."""
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def assert_pose(position: Any, turned: Any, told: dict[str, Any]) -> None:
    """Equal to the tap's to 1e-9."""
    np.testing.assert_allclose([position.x, position.y, position.z], told["position_m"], atol=1e-9)
    np.testing.assert_allclose([turned.w, turned.x, turned.y, turned.z], told["quaternion_wxyz"], atol=1e-9)


@pytest.mark.slow
def test_a_router_that_takes_nothing_is_given_up_and_found_again(tmp_path: Path) -> None:
    """After Zenoh's lease of 10 s; its goodbye, for which it waits as long again, ends nothing."""
    router = Zenoh(tmp_path)
    router.start()
    daemon_end = MadeUpDaemon(tmp_path / "tap.sock", numbered=True)
    try:
        with bridge(router.settings, tmp_path / "tap.sock", tmp_path) as running:
            wait_until(lambda: len(router.frames) > 3)
            router.block()
            wait_until(lambda: "target_lost" in running.log)
            seen = daemon_end.last_seq
            for frames in (200, 400, 600):  # 12 s in all
                wait_until(lambda frames=frames: daemon_end.last_seq > seen + frames)
            router.unblock()
            wait_until(lambda: running.log.count("target_open") == 2)
            assert running.end()["absent"] > 0
    finally:
        daemon_end.close()
        router.unblock()
        router.close()


# Finds its router again and again, as after losses; prints its own memory (kB) after some of them.
AGAIN = """
import re, sys
from contextlib import suppress
from pathlib import Path

from ledpi.links.target import TargetLostError
from ledpi.links.zenoh_ros import ZenohTarget
from ledpi.config.outputs import OutputSettings

target = ZenohTarget(OutputSettings(kind="zenoh", host="127.0.0.1", port=int(sys.argv[1])))
for number in range(61):
    is_open = False
    while not is_open:
        with suppress(TargetLostError):
            target.open()
            target.tell_state("running", {})
            is_open = True
    target.close()
    if number % 20 == 0:
        print(re.search(r"RssAnon:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])
"""
LEFT_OPEN_KB = 20  # what Zenoh keeps of a publisher that was not undeclared


@pytest.mark.slow
def test_a_router_that_is_lost_and_found_again_costs_no_memory(tmp_path: Path) -> None:
    """Whatever was declared is undeclared first."""
    router = Zenoh(tmp_path)
    router.start()
    try:
        command = [sys.executable, "-c", AGAIN, str(router.port)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=limit_s(30), check=True)
    finally:
        router.close()
    _, settled, _, last = map(int, done.stdout.split())
    assert last - settled < 40 * LEFT_OPEN_KB / 2
