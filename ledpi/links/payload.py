"""A frame as bytes for targets that take bytes: a line of JSON, or packets of the wire."""

from __future__ import annotations

import socket
import time
from abc import ABC, abstractmethod
from contextlib import suppress

from ledpi.config.outputs import OutputSettings
from ledpi.core.errors import WireError
from ledpi.daemon.tap.protocol import write_line
from ledpi.links.target import Line
from ledpi.links.wpilib_values import pose_of
from ledpi.wire.codec import encode
from ledpi.wire.message import FixMessage, MarkerMessage, Message, NoFix, State, StatusMessage, wire_pose


class Payload(ABC):
    """The bytes that are sent of a frame and of the daemon's state."""

    def setup(self, hello: Line) -> None:  # noqa: B027
        """Takes the camera and map of the daemon that now runs. Most frames say all that they need."""

    @abstractmethod
    def frame(self, frame: Line, now_ns: int) -> list[bytes]:
        """One frame's datagrams; none where nothing was seen, if the form has nothing to say of that."""

    def robot(self, state: Line, now_ns: int) -> list[bytes]:
        """The bytes of where the robot is; none where the form has no place for it."""
        return []

    @abstractmethod
    def state(self, state: str, health: Line | None) -> bytes:
        """The daemon's state in bytes."""


def payload_of(settings: OutputSettings) -> Payload:
    """The one of the output's `format`. Raises ConfigError where its package is missing."""
    if settings.format == "mavlink":
        from ledpi.links.mavlink import MavlinkPayload  # which loads the decoder, for the map

        return MavlinkPayload(settings.mavlink_profile, settings.mavlink_system)
    return JsonPayload() if settings.format == "json" else WirePayload()


def with_age(values: Line, now_ns: int, key: str = "exposed_ns") -> Line:
    """Adds how old it is (µs), and when it was exposed, or held, as Unix time (ns); both of `key`."""
    age_ns = now_ns - values[key]
    return values | {"age_us": age_ns // 1000, "unix_ns": time.time_ns() - age_ns}


def with_host(values: Line) -> Line:
    """Adds which machine says it: many may send to one place."""
    return values | {"host": socket.gethostname()}


class BytesTarget(ABC):
    """A target that takes bytes: one write for each datagram of a frame, and for the daemon's state."""

    def __init__(self, settings: OutputSettings) -> None:
        self._payload = payload_of(settings)

    def tell_setup(self, hello: Line) -> None:
        """Sends nothing: a listener may come at any time."""
        self._payload.setup(hello)

    def send(self, frame: Line, now_ns: int) -> bool:
        return all(self._write(data) for data in self._payload.frame(frame, now_ns))

    def send_robot(self, state: Line, now_ns: int) -> None:
        for data in self._payload.robot(state, now_ns):
            self._write(data)

    def tell_state(self, state: str, health: Line | None) -> None:
        self._write(self._payload.state(state, health))

    @abstractmethod
    def _write(self, data: bytes) -> bool:
        """Writes all or nothing, and returns which. Raises TargetLostError."""


class JsonPayload(Payload):
    """The tap's own lines, each with its age."""

    def frame(self, frame: Line, now_ns: int) -> list[bytes]:
        return [write_line(with_host(with_age(frame, now_ns)))]

    def robot(self, state: Line, now_ns: int) -> list[bytes]:
        return [write_line(with_host(with_age(state, now_ns, "t_ns")))]

    def state(self, state: str, health: Line | None) -> bytes:
        return write_line(with_host(health or {"type": "state", "state": state}))


class WirePayload(Payload):
    """Packets as on the serial line, the fix first. The sequence number begins at 0, so that a restart is seen."""

    def __init__(self) -> None:
        self._sequence = 0

    def frame(self, frame: Line, now_ns: int) -> list[bytes]:
        packets = []
        for message in messages_of(frame, now_ns):
            with suppress(WireError):  # out of a packet's range: never sent, as on the serial line
                packets.append(self._encode(message))
        return [b"".join(packets)] if packets else []

    def state(self, state: str, health: Line | None) -> bytes:
        return self._encode(status(state, health or {}))

    def _encode(self, message: Message) -> bytes:
        frame = encode(message, self._sequence)
        self._sequence = self._sequence % 0xFFFF + 1
        return frame


def messages_of(frame: Line, now_ns: int, map_resets: int = 0) -> list[Message]:
    """The fix first, then panels and bodies; without those that must not be sent."""
    found: list[Message] = []
    if frame["robot"] is not None:
        with suppress(WireError):
            found.append(_fix(frame["robot"], now_ns, map_resets))
    for marker in frame["markers"]:
        with suppress(WireError):
            found += _marker(marker, now_ns)
    for body in frame.get("bodies", ()):
        with suppress(WireError):
            found += _marker({**body, "alternate": None}, now_ns)
    return found


def _fix(fix: Line, now_ns: int, map_resets: int) -> FixMessage:
    return FixMessage(
        age_us=(now_ns - fix["exposed_ns"]) // 1000,
        pose=wire_pose(pose_of(fix)),
        panels_used=len(fix["panels_used"]),
        map_resets=map_resets,
    )


def _marker(marker: Line, now_ns: int) -> list[Message]:
    """One panel's, and its mirror pose's where that is not excluded."""
    age_us = (now_ns - marker["exposed_ns"]) // 1000
    uncalibrated, other = marker["position_m"] is None, marker["alternate"]
    pose = None if uncalibrated else wire_pose(pose_of(marker))
    ambiguous = other is not None
    first = MarkerMessage(id=marker["id"], age_us=age_us, pose=pose, uncalibrated=uncalibrated, ambiguous=ambiguous)
    if other is None:
        return [first]
    pose = wire_pose(pose_of(other))
    return [first, MarkerMessage(id=marker["id"], age_us=age_us, pose=pose, ambiguous=True, alternate=True)]


def status(state: str, health: Line) -> StatusMessage:
    """The daemon's."""
    known = State.__members__.get(state.upper(), State.STOPPING)  # no_daemon: it has ended
    no_fix = NoFix.__members__.get(str(health.get("no_fix", "not_running")).upper(), NoFix.UNKNOWN)
    return StatusMessage(
        state=known,
        no_fix=no_fix,
        panels_in_view=health.get("in_view"),
        temperature_c=health.get("temperature_c"),
        throttling=health.get("throttled"),
        uptime_s=health.get("uptime_s"),
        frames=health.get("frames"),
        frames_dropped=health.get("dropped_frames"),
    )
