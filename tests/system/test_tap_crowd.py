"""Whoever follows the tap, the daemon's poses leave in time: seen on its wire, with a crowd and without in turns."""

from __future__ import annotations

import threading
from pathlib import Path
from statistics import median

import pytest

from ledpi.tap.client import connect
from tests.builders.daemon import controller, daemon, write_recording
from tests.builders.tap import Raw, at, reach

# It tells how late a daemon is: no other test may take the processor meanwhile.
pytestmark = [pytest.mark.slow, pytest.mark.alone]


def test_poses_leave_as_soon_with_a_crowd_as_without(tmp_path: Path) -> None:
    """Two that watch with pictures, ten that ask and never read, one that sends garbage: in turns with none of them."""
    write_recording(tmp_path / "take", 120)
    path = tmp_path / "tap.sock"
    taken: dict[bool, list[int]] = {False: [], True: []}
    with (
        controller() as line,
        daemon(
            f"camera.source=recording:{tmp_path / 'take'}",
            f"serial.port={line.port}",
            at(path),
            options=("--frames", "1000000"),
        ) as process,
    ):
        reach(path).close()
        line.wait_for(lambda line: len(line.markers) > 30)
        for crowded in (False, True) * 3:
            ending = threading.Event()
            crowd = [threading.Thread(target=watch, args=(path, ending)) for _ in range(2 * crowded)]
            for thread in crowd:
                thread.start()
            stalled = [stall(path) for _ in range(10 * crowded)]
            seen = len(line.markers)
            line.wait_for(lambda line, seen=seen: len(line.markers) > seen + 60)  # type: ignore[misc]
            taken[crowded] += [marker.age_us for marker in line.markers[seen:]]
            ending.set()
            for thread in crowd:
                thread.join()
            for client in stalled:
                client.close()
        assert process.poll() is None
    assert median(taken[True]) < 1.3 * median(taken[False]) + 1000


def watch(path: Path, ending: threading.Event) -> None:
    """As a page does, as often as it is served."""
    with connect(path) as client:
        while not ending.is_set():
            client.picture("rejected", "evidence")


def stall(path: Path) -> Raw:
    """Asks for more than it can get, and for nonsense, and reads nothing."""
    client = Raw(path)
    for number in range(20):
        client.send({"do": "picture", "id": number})
    client.send(b"nonsense\n")
    return client
