"""`kind: nt`: NetworkTables 4, by WPILib's own ntcore. docs/networktables.md has the topics and a robot program.

Each value carries the time at which its pose was true, on NetworkTables' clock, which client and server keep equal.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import ntcore

from ledpi.config.outputs import OutputSettings
from ledpi.core.records import Floats
from ledpi.links import photon
from ledpi.links.target import Line, TargetLostError
from ledpi.links.wpilib_values import SCHEMAS, TYPES, frame_values, state_values

OPEN_S = 0.25  # that one look for the server takes; ntcore itself goes on looking
IDENTITY = "ledpi"


class NtTarget:
    """One server: a robot's, or a simulation's."""

    def __init__(self, settings: OutputSettings) -> None:
        self._address = settings.address
        self._where = "{}:{}".format(*settings.address)
        self._table = f"/{settings.base_topic}"
        self._photon_camera = settings.photon_camera
        self._size = (640, 480)  # of the picture
        self._mount: Floats | None = None
        self._instance: Any = None
        self._publishers: dict[str, Any] = {}

    def open(self) -> None:
        if self._instance is None:
            self._instance = ntcore.NetworkTableInstance.create()
            self._instance.setServer(*self._address)
            self._instance.startClient4(IDENTITY)
            for name, schema in SCHEMAS.items():
                self._instance.addSchema(f"struct:{name}", "structschema", schema)
        until_s = time.monotonic() + OPEN_S
        while not self._instance.isConnected():
            if time.monotonic() > until_s:
                raise TargetLostError(f"{self._where}: no NetworkTables server answers; are host and port right?")
            time.sleep(0.01)

    def tell_setup(self, hello: Line) -> None:
        self._size = hello["camera"]["width"], hello["camera"]["height"]
        self._mount = photon.mount_of(hello)

    def send(self, frame: Line, now_ns: int) -> bool:
        self._check()
        for name, kind, value, exposed_ns in frame_values(frame):
            self._put(name, kind, value, _nt_time(exposed_ns, now_ns))
        if self._photon_camera is not None:
            self._put_photon(frame, now_ns)
        self._instance.flush()
        return True

    def send_robot(self, state: Line, now_ns: int) -> None:
        self._check()
        for name, kind, value, at_ns in state_values(state):
            self._put(name, kind, value, _nt_time(at_ns, now_ns))
        self._put("robot_state/mode", "String", state["mode"], _nt_time(int(state["t_ns"]), now_ns))
        self._instance.flush()

    def tell_state(self, state: str, health: Line | None) -> None:
        self._check()
        self._put("state", "String", state, 0)
        if health is not None:
            self._put("no_fix", "String", str(health.get("no_fix")), 0)
            self._put("frames_per_s", "Double", float(health.get("decoded_per_s") or 0.0), 0)
        self._instance.flush()

    def tick(self) -> None:
        self._check()

    def close(self) -> None:
        instance, self._instance = self._instance, None
        self._publishers.clear()
        if instance is not None:
            instance.stopClient()
            ntcore.NetworkTableInstance.destroy(instance)

    def _check(self) -> None:
        """A server that is back must not be told what was true before: all begins anew."""
        if not self._instance.isConnected():
            raise TargetLostError(f"{self._where}: the connection is lost")

    def _put_photon(self, frame: Line, now_ns: int) -> None:
        """On PhotonVision's own topics; the camera counts as connected while its heartbeat goes on."""
        offset_us, published_us = self._instance.getServerTimeOffset() or 0, int(ntcore._now())
        captured_us = _nt_time(int(frame["exposed_ns"]), now_ns) + offset_us
        table = f"/photonvision/{self._photon_camera}"
        raw = self._publisher(f"{table}/rawBytes", publish_photon, "Raw")
        raw.set(photon.packet(frame, self._size, captured_us, published_us + offset_us, self._mount), published_us)
        beat = self._publisher(f"{table}/heartbeat", lambda topic, options: topic.publish(options), "Integer")
        beat.set(frame["seq"], published_us)

    def _put(self, name: str, kind: str, value: object, at_us: int) -> None:
        form, of = ("Raw", [TYPES[kind]]) if kind in SCHEMAS else (kind, [])
        self._publisher(f"{self._table}/{name}", lambda topic, options: topic.publish(*of, options), form).set(
            value, at_us
        )

    def _publisher(self, name: str, publish: Callable[[Any, Any], Any], kind: str) -> Any:
        publisher = self._publishers.get(name)
        if publisher is None:
            topic = getattr(self._instance, f"get{kind}Topic")(name)
            publisher = publish(topic, ntcore.PubSubOptions(keepDuplicates=True, periodic=0.005))
            self._publishers[name] = publisher
        return publisher


def publish_photon(topic: Any, options: Any) -> Any:
    return topic.publishEx(photon.TYPE, photon.PROPERTIES, options)


def _nt_time(exposed_ns: int, now_ns: int) -> int:
    """When it was exposed, in µs of this machine's NetworkTables clock; ntcore tells the server in its own."""
    return int(ntcore._now()) - (now_ns - exposed_ns) // 1000
