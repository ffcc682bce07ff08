"""`format: mavlink`: a frame as the MAVLink packets of the serial line (ledpi.wire.mavlink)."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from ledpi.config.robot import CameraMount, base_link_from_camera
from ledpi.core.errors import WireError
from ledpi.core.records import Floats
from ledpi.daemon.tap.frames import map_told
from ledpi.links.payload import Payload, messages_of, status
from ledpi.links.target import Line
from ledpi.wire.mavlink import Mavlink, Profile, Resets
from ledpi.wire.message import Message


class MavlinkPayload(Payload):
    """HEARTBEAT with each state, the fix before the panels. The number of packets goes on whatever the daemon does.

    Each packet is a datagram of its own: ArduPilot's network ports cut one after 300 bytes.
    """

    def __init__(self, profile: Profile, system: int) -> None:
        """`system`: the vehicle's. Raises ConfigError without pymavlink."""
        self._profile, self._system = profile, system
        self._resets = Resets()
        self._mavlink = self._codec(np.eye(4))

    def setup(self, hello: Line) -> None:
        told = hello.get("camera_mount") or {}
        given = {key: told[key] for key in CameraMount.model_fields if told.get(key) is not None}
        mavlink = self._codec(base_link_from_camera(CameraMount(**given)))
        mavlink.continue_after(self._mavlink)
        self._mavlink = mavlink
        self._resets.update_map(map_told(hello))

    def frame(self, frame: Line, now_ns: int) -> list[bytes]:
        packets = []
        for message in messages_of(frame, now_ns, self._resets.maps % 256):
            with suppress(WireError):  # an ID that MAVLink has no place for: not sent, as on the serial line
                packets.append(self._packet(message, now_ns))
        return [packet for packet in packets if packet]

    def state(self, state: str, health: Line | None) -> bytes:
        return self._packet(status(state, health or {}), 0)

    def _codec(self, camera: Floats) -> Mavlink:
        return Mavlink(base_link_from_camera=camera, profile=self._profile, system=self._system, resets=self._resets)

    def _packet(self, message: Message, now_ns: int) -> bytes:
        packet = self._mavlink.encode(message, now_ns)
        if packet is None:
            return b""
        self._mavlink.count_sent()
        return packet
