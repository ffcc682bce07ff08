"""The tap's clients: what they ask is taken in turns, but what takes no time at once."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from ledpi.daemon.tap.crowd import Bell, Crowd, Listening


@pytest.fixture
def crowd(tmp_path: Path) -> Iterator[Crowd]:
    listening = Listening(tmp_path / "tap.sock")
    crowd = Crowd(listening, Bell())
    yield crowd
    crowd.close()
    listening.close()


def test_odometry_does_not_wait_for_its_turn(crowd: Crowd, tmp_path: Path) -> None:
    """All that has come is taken in one turn, or fifty a second would fall behind; of other requests one a client."""
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(str(tmp_path / "tap.sock"))
        odometry = b"".join(b'{"do": "odometry", "t_ns": %d, "left_m": 0, "right_m": 0}\n' % n for n in range(5))
        client.sendall(odometry + b'{"do": "takes", "id": 1}\n{"do": "takes", "id": 2}\n' + odometry)
        for _ in range(2):  # it is welcome, then heard
            crowd.wait(1.0)
        turns = [[request.do for _, request in crowd.requests()] for _ in range(3)]
    assert turns == [["odometry"] * 5 + ["takes"], ["takes"], ["odometry"] * 5]
