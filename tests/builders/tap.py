"""A tap without a daemon: frames that show one panel, and raw clients that may misbehave."""

from __future__ import annotations

import json
import select
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ledpi.config.panels import PanelSettings
from ledpi.core.errors import TapError
from ledpi.core.records import CameraInfo, Decoded, Frame, Rejected
from ledpi.daemon.tap.client import Client, connect
from ledpi.daemon.tap.messages import Setup
from ledpi.daemon.tap.server import Tap
from tests.builders.waiting import limit_s, wait_until

HEIGHT, WIDTH = 48, 64
CAMERA = CameraInfo(width=WIDTH, height=HEIGHT, exposure_us=1000.0, row_time_us=20.0, transfer="linear")
SETUP = Setup(
    pid=1,
    camera=CAMERA,
    source="simulated",
    intrinsics=None,
    panels=PanelSettings(side_m=0.16),
    panel_map=None,
    values={"tap.socket": "auto"},
    origins={"tap.socket": "default"},
    config_path=None,
)


def frame(seq: int) -> Frame:
    """Each of another grey, read out just now."""
    now_ns = time.monotonic_ns()
    pixels = np.full((HEIGHT, WIDTH), seq % 256, np.uint8)
    return Frame(
        pixels=pixels, seq=seq, row0_readout_ns=now_ns, exposure_us=1000.0, row_time_us=20.0, transfer="linear"
    )


def decoded(of: Frame) -> Decoded:
    """Nothing was read."""
    why = (Rejected(stage="fit", reason="misfit"),)
    return Decoded(
        seq=of.seq,
        row0_readout_ns=of.row0_readout_ns,
        host_offset_ns=of.host_offset_ns,
        markers=(),
        robot=None,
        rejected=why,
        stage_ms={"find": 1.0},
    )


def show(tap: Tap, seq: int) -> None:
    """One frame, with whatever was asked for."""
    one = frame(seq)
    tap.show(one, decoded(one), tap.trace())


@contextmanager
def tap_at(path: Path) -> Iterator[Tap]:
    """One of which a daemon has begun."""
    tap = Tap(path)
    try:
        tap.begin(SETUP)
        tap.start()
        yield tap
    finally:
        tap.close()


class Raw:
    """A client that is no better than its user. `close_all` ends those that a test has left."""

    left: ClassVar[list[Raw]] = []

    def __init__(self, path: Path) -> None:
        self.left.append(self)
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.settimeout(limit_s())
        self.socket.connect(str(path))
        self._file = self.socket.makefile("rb")

    def send(self, line: bytes | str | dict[str, Any]) -> None:
        data = json.dumps(line) + "\n" if isinstance(line, dict) else line
        self.socket.sendall(data.encode() if isinstance(data, str) else data)

    def line(self) -> dict[str, Any]:
        """The next; raw bytes that follow it are read and left."""
        text = self._file.readline()
        assert text, "the daemon has closed"
        values: dict[str, Any] = json.loads(text)
        self._file.read(values.get("bytes", 0))
        return values

    def next(self, kind: str) -> dict[str, Any]:
        """The next of its kind."""
        while (line := self.line())["type"] != kind:
            pass
        return line

    def is_hung_up(self) -> bool:
        """Without reading anything."""
        poll = select.poll()
        poll.register(self.socket, 0)
        return bool(poll.poll(0))

    def is_closed(self) -> bool:
        """Reads all that is left."""
        try:
            while self._file.readline():
                pass
        except ConnectionResetError:
            pass
        return True

    def close(self) -> None:
        self._file.close()
        self.socket.close()

    @classmethod
    def close_all(cls) -> None:
        while cls.left:
            cls.left.pop().close()


def reach(path: Path) -> Client:
    """As soon as the daemon is there."""

    def client() -> Client | None:
        with suppress(TapError):
            return connect(path)
        return None

    found = wait_until(client, f"a daemon at {path}")
    assert found is not None
    return found


def at(path: Path) -> str:
    """The setting."""
    return f"tap.socket={path}"
