"""A node of ROS 2 without ROS, which subscribes to topics that it knows; and what it heard beside what the tap told.

It knows rmw_zenoh's names and ROS 2's own types alone. As a robot's program does, it subscribes before anybody
publishes, so nothing hangs on when it discovers whom.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from ledpi.camera.simulate.scenes import DRIVE_IDS, drive_map
from ledpi.config.map_yaml import map_text
from tests.builders import ROOT
from tests.builders.bridges import LEDPI, ZENOH_ROUTER, bridge, free_port
from tests.builders.daemon import daemon, slowness
from tests.builders.tap import at, reach
from tests.builders.waiting import wait_until

LONG_MS = 10_000  # no pose grows too old, however busy the machine is
FRAME_US = 17_000
POSE, TF = "geometry_msgs/msg/PoseWithCovarianceStamped", "tf2_msgs/msg/TFMessage"
PANELS = tuple(f"/ledpi/panel_{number}" for number in DRIVE_IDS)
DETECTIONS = "/ledpi/detections"  # one message of each frame; vision_msgs are no part of ROS 2's own types
TYPES = {"/tf": TF, "/ledpi/pose": POSE, **dict.fromkeys(PANELS, POSE)}
NODE = (
    ZENOH_ROUTER
    + """
def subscribe(topic, name):
    def hear(sample):  # at once, as one piece: each topic has a thread of its own
        sys.stdout.write(f"{topic} {bytes(sample.payload).hex()}\\n")
        sys.stdout.flush()

    return session.declare_subscriber(f"0{topic}/{name}", hear)


def its_name(kind):
    package, of, last = kind.split("/")
    return f"{package}::{of}::dds_::{last}_/{types.hash_rihs01(kind)}"


told = json.loads(sys.argv[2])
subscribers = [subscribe(topic, its_name(kind)) for topic, kind in told.items()]
subscribers.append(subscribe(sys.argv[3], "**"))
print("ready", flush=True)
time.sleep(1e6)
"""
)


@dataclass(frozen=True)
class Drive:
    """A drive as the tap told it and as the node heard it, and the bridge's counters."""

    told: list[dict[str, Any]]  # `decoded`
    heard: dict[str, list[bytes]]  # messages as they came, by topic
    counters: dict[str, int]
    unix_offset_ns: int

    @property
    def reached(self) -> list[dict[str, Any]]:
        """The told frames whose detections have arrived."""
        stamps = sorted(_stamp_ns(data) for data in self.heard[DETECTIONS])
        return [line for line in self.told if near(stamps, self.unix_ns(line)) is not None]

    def unix_ns(self, told: dict[str, Any]) -> int:
        """Returns when a frame, a panel or a robot was exposed."""
        return int(told["exposed_ns"]) + self.unix_offset_ns

    def messages(self, topic: str) -> list[Any]:
        """As ROS 2's types have them."""
        store = get_typestore(Stores.ROS2_JAZZY)
        return [store.deserialize_cdr(data, TYPES[topic]) for data in self.heard[topic]]


def _stamp_ns(data: bytes) -> int:
    """Reads it of the header that a message begins with, after the four bytes of CDR's own."""
    seconds, nanoseconds = np.frombuffer(data[4:12], "<u4").tolist()
    return int(seconds) * 10**9 + int(nanoseconds)


def near(stamps: list[int], time_ns: int) -> int | None:
    """The place of the one within half a frame of it, as the bridge and this process read two clocks one after the
    other. `stamps`: sorted.
    """
    place = bisect_left(stamps, time_ns)
    around = [k for k in (place - 1, place) if 0 <= k < len(stamps)]
    found = min(around, key=lambda k: abs(stamps[k] - time_ns), default=None)
    return None if found is None or abs(stamps[found] - time_ns) > FRAME_US * 500 else found


def render(take: Path, frames: int) -> None:
    """Ten seconds there and back are 588 frames; a daemon repeats them."""
    sets = ("panels.side_m=0.16", "camera.width=320", "camera.height=240", f"camera.frame_duration_us={FRAME_US}")
    command = [*LEDPI, "simulate", str(take), "--scene", "drive", "--frames", str(frames)]
    command += [part for item in sets for part in ("--set", item)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)


@contextmanager
def node(port: int) -> Iterator[list[tuple[str, bytes]]]:
    """Gives what it has heard so far, by topic."""
    command = [sys.executable, "-c", NODE, str(port), json.dumps(TYPES), DETECTIONS]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    heard: list[tuple[str, bytes]] = []

    def read(lines: Any) -> None:
        for line in lines:
            topic, data = line.split()
            heard.append((topic, bytes.fromhex(data)))

    reader = threading.Thread(target=read, args=(process.stdout,), daemon=True)
    reader.start()
    try:
        yield heard
    finally:
        process.kill()
        reader.join()
        process.stdout.close()
        process.wait()


def driven(folder: Path, frames: int, of_recording: int) -> Drive:
    """Drives so many frames, a recording of fewer again and again, and sends them to the node."""
    take, path, markers, port = folder / "take", folder / "tap.sock", folder / "markers.yaml", free_port()
    render(take, of_recording)
    markers.write_text(map_text(drive_map(), "The drive."), encoding="utf-8")
    given = (f"camera.source=recording:{take}", f"map={markers}", at(path), f"serial.max_age_ms={LONG_MS}")
    settings = {"kind": "zenoh", "host": "127.0.0.1", "port": port}
    with node(port) as heard, bridge(settings, path, folder, max_age_ms=LONG_MS) as running:
        wait_until(lambda: "target_open" in running.log)
        with daemon(*given, options=("--frames", str(frames))), reach(path) as tap:
            told = [line for line in tap.lines() if line["type"] == "decoded"]
        counters, count = running.end(), -1
        while count != len(heard):  # what is on its way
            count = len(heard)
            time.sleep(slowness())
    by_topic: dict[str, list[bytes]] = {topic: [] for topic in (*TYPES, DETECTIONS)}
    for topic, data in heard:
        by_topic[topic].append(data)
    return Drive(told, by_topic, counters, time.time_ns() - time.monotonic_ns())
