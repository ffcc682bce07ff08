"""A daemon's poses in ROS 2, without ROS: a participant that knows only rmw_zenoh's names and ROS 2's IDL."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("zenoh", reason="eclipse-zenoh is not installed")
pytest.importorskip("rosbags", reason="rosbags is not installed")

from tests.builders import ROOT
from tests.builders.bridges import ZENOH_ROUTER, Zenoh, bridge, free_port
from tests.builders.daemon import daemon, slowness, write_recording
from tests.builders.made_up_daemon import MadeUpDaemon
from tests.builders.tap import at, reach, wait_until

# A router, and a node that subscribes to all that it is told of by liveliness tokens, as ROS 2's tools do.
LONG_MS = 10_000  # no pose grows too old, however busy the machine is
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
        line = json.dumps({"topic": topic, "type": name, "node": node, "message": message})
        sys.stdout.write(line + "\\n")  # at once: each topic has a thread of its own
        sys.stdout.flush()

    subscribers[topic] = session.declare_subscriber(f"{domain}{topic}/{kind}/{its_hash}", hear)


tokens = session.liveliness().declare_subscriber("@ros2_lv/0/**", meet, history=True)
print("ready", flush=True)
time.sleep(1e6)
"""
)


def heard_of(take: Path, folder: Path, frames: int) -> tuple[list[dict[str, Any]], list[dict[str, Any]], int]:
    """Returns what the participant heard, and the tap's lines of a daemon that replays `take`."""
    port, path = free_port(), folder / "tap.sock"
    command = [sys.executable, "-c", PARTICIPANT, str(port)]
    participant = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert participant.stdout is not None
    assert participant.stdout.readline() == "ready\n"
    heard: list[dict[str, Any]] = []
    reader = threading.Thread(target=lambda lines: heard.extend(map(json.loads, lines)), args=(participant.stdout,))
    reader.start()
    source = f"camera.source=recording:{take}"
    settings = {"kind": "zenoh", "host": "127.0.0.1", "port": port}
    with bridge(settings, path, folder, max_age_ms=LONG_MS) as running:
        with (
            daemon(source, at(path), f"serial.max_age_ms={LONG_MS}", options=("--frames", str(frames))),
            reach(path) as tap,
        ):
            told = [line for line in tap.lines() if line["type"] == "decoded"]
        counters = running.end()
    count = -1
    while count != len(heard):  # what is on its way
        count = len(heard)
        time.sleep(slowness())
    participant.kill()
    reader.join()
    participant.stdout.close()
    participant.wait()
    assert counters["refused"] == counters["stale"] == 0
    return heard, told, counters["replaced"]


def test_every_pose_arrives_with_its_covariance_and_tf(tmp_path: Path) -> None:
    """From the first that both were there for; each as the tap tells it."""
    write_recording(tmp_path / "take", 30, rows=3 * 504)
    heard, told, replaced = heard_of(tmp_path / "take", tmp_path, 30)
    poses = [each["message"] for each in heard if each["topic"] == "/ledpi/panel_7"]
    transforms = [each["message"]["transforms"] for each in heard if each["topic"] == "/tf"]
    certain = [line["markers"][0] for line in told if line["markers"] and line["markers"][0]["alternate"] is None]
    offset_ns = time.time_ns() - time.monotonic_ns()
    assert len(certain) > 15

    def of_tap(message: dict[str, Any]) -> int:
        """The place among `certain` of what was exposed when `message` was."""
        stamp = message["header"]["stamp"]
        exposed_ns = stamp["sec"] * 10**9 + stamp["nanosec"] - offset_ns
        return min(range(len(certain)), key=lambda k: abs(certain[k]["exposed_ns"] - exposed_ns))

    for pose in poses:
        np.testing.assert_allclose(pose["pose"]["covariance"], certain[of_tap(pose)]["covariance"], rtol=1e-12)
    assert len(poses) > 3
    for arrived in (poses, [transform for (transform,) in transforms]):
        # Each topic is discovered by itself. From then on all arrives that the bridge has not replaced by newer ones.
        assert len(certain) - of_tap(arrived[0]) - replaced <= len(arrived) <= len(certain)
    assert {transform["child_frame_id"] for (transform,) in transforms} == {"panel_7"}
    assert {each["node"] for each in heard} == {"ledpi"}


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
            wait_until(lambda: daemon_end.last_seq > seen + 600)  # 12 s
            router.unblock()
            wait_until(lambda: running.log.count("target_open") == 2)
            assert running.end()["absent"] > 0
    finally:
        daemon_end.close()
        router.unblock()
        router.close()
