"""The far end of a bridge, as the bridge sees it: a contract, which each kind keeps (tests/spec/test_bridges.py)."""

from __future__ import annotations

from typing import Any, Protocol

from ledpi.core.errors import LedpiError, TransientError

Line = dict[str, Any]  # of the tap

# What lies in the system's buffer unread is old when it is read. With more of it than this a new frame is dropped
# instead: about 0.1 s of a camera's frames.
UNSENT_BYTES = 1 << 14
CONNECT_S = 2.0
# After so long without an answer a connection is given up, and what waits in it is never delivered: it would be old.
UNANSWERED_MS = 1000


class BridgeError(LedpiError):
    """A bridge's settings do not fit its target: a person has to act."""


class TargetLostError(TransientError):
    """The target is not there, or not there any more; it is tried again."""


class Target(Protocol):
    """One connection. Each call returns soon, whatever the other side does; only `open` may take `CONNECT_S`."""

    def open(self) -> None:
        """Connects. Raises TargetLostError where it may work later, BridgeError where a person has to act.

        Then nothing is left open that another call would not use.
        """

    def tell_setup(self, hello: Line) -> None:
        """Takes the camera, panels and map of the daemon that now runs. Raises TargetLostError."""

    def send(self, frame: Line, now_ns: int) -> bool:
        """Hands over one `decoded` line. Returns False where there is no room: the frame is dropped, never kept.

        `now_ns`: CLOCK_MONOTONIC, against which ages are taken. Raises TargetLostError.
        """

    def send_robot(self, state: Line, now_ns: int) -> None:
        """Hands over one `robot_state` line, where the target has a place for it. Raises TargetLostError."""

    def tell_state(self, state: str, health: Line | None) -> None:
        """Says how the daemon is: `running`, `no_daemon` …; `health`: each second its line. Raises TargetLostError."""

    def tick(self) -> None:
        """Does what a connection needs though nothing is sent, ten times a second. Raises TargetLostError."""

    def close(self) -> None:
        """Says goodbye, where the target knows such a thing. Safe at any time."""
