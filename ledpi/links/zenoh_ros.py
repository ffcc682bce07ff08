"""`kind: zenoh`: ROS 2's own topics over Zenoh, as rmw_zenoh names and packs them. No ROS is needed here.

Of what ROS 2 speaks, Zenoh is the one with wheels for 64-bit ARM; rmw_zenoh comes with ROS 2 from Jazzy on. Its names:
the data's key is DOMAIN/TOPIC/TYPE/HASH, each node and publisher tells of itself by a liveliness token below @ros2_lv,
and with each message goes an attachment of sequence number, time and the publisher's number (rmw_zenoh, design.md).
"""

from __future__ import annotations

import json
import threading
import time
from contextlib import suppress
from typing import Any

import zenoh

from ledpi.config.outputs import OutputSettings
from ledpi.links.ros.contents import Message, Names
from ledpi.links.ros.stream import RosStream
from ledpi.links.ros.types import to_cdr, type_hash
from ledpi.links.target import Line, TargetLostError

OPEN_S = 0.25  # that one look for the router takes
GOODBYE_S = 2.0  # within which a router that listens has taken what is on its way
QOS = "::,10:,:,:,,"  # rmw's default but for the depth: what is default is left empty
GID_BYTES = 16
# Zenoh drops a message for which there is no room within 1 ms, in a queue of two; a frame's come all at once, and on a
# busy machine the thread that empties the queue may not have had its turn by then. Both ends still bound what waits.
QUEUE = {
    "transport/link/tx/queue/size/data": 16,
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 200_000,  # µs; five messages: 1 s
}


class ZenohTarget:
    """A router (`ros2 run rmw_zenoh_cpp rmw_zenohd`), and with it every node that it knows."""

    def __init__(self, settings: OutputSettings) -> None:
        host, port = settings.address
        self._where = f"{host}:{port}"
        self._endpoint = f"tcp/{f'[{host}]' if ':' in host else host}:{port}"
        self._domain = settings.domain
        namespace, _, node = settings.base_topic.rpartition("/")  # so robots with topics of their own are nodes, too
        self._node = f"%/{mangled(f'/{namespace}')}/{node}"  # behind its enclave
        self._stream = RosStream(
            Names(
                topic=f"/{settings.base_topic}",
                source=settings.base_topic,
                camera_frame=settings.camera_frame,
                map_frame=settings.map_frame,
                frame_prefix=settings.frame_prefix,
                publish_tf=settings.publish_tf,
                dock_id=settings.dock_id,
            )
        )
        self._session: Any = None
        self._publishers: dict[str, _Publisher] = {}
        self._tokens: list[Any] = []

    def open(self) -> None:
        """Zenoh itself goes on looking while it has not found the router."""
        if self._session is None:
            self._session = zenoh.open(self._config())
            token = f"{self._token_begin(0)}/NN/{self._node}"
            self._tokens = [self._session.liveliness().declare_token(token)]
        until_s = time.monotonic() + OPEN_S
        while not self._has_router():
            if time.monotonic() > until_s:
                raise TargetLostError(f"{self._where}: no Zenoh router answers; is it started, and the port right?")
            time.sleep(0.02)

    def tell_setup(self, hello: Line) -> None:
        """The panels' sides; nothing is sent."""
        self._stream.begin(hello)

    def send(self, frame: Line, now_ns: int) -> bool:
        self.tick()
        for message in self._stream.frame(frame, time.time_ns() - time.monotonic_ns()):
            self._put(message)
        return True

    def send_robot(self, state: Line, now_ns: int) -> None:
        for message in self._stream.robot(state, time.time_ns() - time.monotonic_ns()):
            self._put(message)

    def tell_state(self, state: str, health: Line | None) -> None:
        self.tick()
        self._put(self._stream.health(state, health, time.time_ns()))

    def tick(self) -> None:
        if not self._has_router():
            raise TargetLostError(f"{self._where}: the router is gone")

    def close(self) -> None:
        """Says goodbye in a thread of its own: to a router that takes nothing Zenoh waits 10 s, and then raises."""
        session, self._session = self._session, None
        declared = [*self._publishers.values(), *self._tokens]
        self._publishers, self._tokens = {}, []
        if session is not None:
            goodbye = threading.Thread(target=_part, args=(session, declared), daemon=True)
            goodbye.start()
            goodbye.join(GOODBYE_S)

    def _config(self) -> Any:
        """As rmw_zenoh's own sessions: a peer that asks the router who else there is."""
        config = zenoh.Config()
        values = {
            "mode": "peer",
            "connect/endpoints": [self._endpoint],
            "connect/timeout_ms": -1,  # goes on trying
            "connect/retry": {"period_init_ms": 200, "period_max_ms": 500, "period_increase_factor": 1.5},
            "connect/exit_on_failure": False,
            "listen/endpoints": ["tcp/localhost:0"],
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": True,
            "transport/shared_memory/enabled": False,  # else a file stays open of each router that was ever there
            "queries_default_timeout": 1000,
            **QUEUE,
        }
        for key, value in values.items():
            config.insert_json5(key, json.dumps(value))
        return config

    def _has_router(self) -> bool:
        return bool(self._session.info.routers_zid())

    def _token_begin(self, entity: int) -> str:
        return f"@ros2_lv/{self._domain}/{self._session.info.zid()}/0/{entity}"

    def _put(self, message: Message) -> None:
        publisher = self._publishers.get(message.topic)
        if publisher is None:
            publisher = self._publishers[message.topic] = self._declare(message)
        publisher.put(to_cdr(message.type, message.values))

    def _declare(self, message: Message) -> _Publisher:
        entity = len(self._publishers) + 1
        kind, its_hash = dds_type(message.type), type_hash(message.type)
        topic = mangled(message.topic)
        token = f"{self._token_begin(entity)}/MP/{self._node}/{topic}/{kind}/{its_hash}/{QOS}"
        self._tokens.append(self._session.liveliness().declare_token(token))
        return _Publisher(self._session, f"{self._domain}{message.topic}/{kind}/{its_hash}", entity)


class _Publisher:
    """One topic's."""

    def __init__(self, session: Any, key: str, entity: int) -> None:
        self._publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP, express=True)
        self._gid = (int(str(session.info.zid()), 16) + entity).to_bytes(GID_BYTES + 1, "little")[:GID_BYTES]
        self._sequence = 0

    def undeclare(self) -> None:
        """Raises ZError."""
        self._publisher.undeclare()

    def put(self, data: bytes) -> None:
        """Sends it. What cannot leave at once is dropped by Zenoh."""
        self._sequence += 1
        self._publisher.put(data, attachment=attachment(self._sequence, time.time_ns(), self._gid))


def _part(session: Any, declared: list[Any]) -> None:
    """Closes a session, and before it what was declared in it: Zenoh keeps some 20 kB of each publisher that it closes
    by itself. That, too, waits for the router.
    """
    for each in declared:
        with suppress(zenoh.ZError):
            each.undeclare()
    with suppress(zenoh.ZError):
        session.close()


def mangled(name: str) -> str:
    """A name of ROS 2 as one part of a key of Zenoh's."""
    return name.replace("/", "%")


def dds_type(name: str) -> str:
    """`geometry_msgs/msg/Pose` as `geometry_msgs::msg::dds_::Pose_`."""
    package, kind, last = name.split("/")
    return f"{package}::{kind}::dds_::{last}_"


def attachment(sequence: int, time_ns: int, gid: bytes) -> bytes:
    """Three keys with their values, in Zenoh's own serialization: lengths as LEB128, numbers little endian."""

    def sized(data: bytes) -> bytes:
        return bytes([len(data)]) + data  # all are shorter than 128

    numbers = (("sequence_number", sequence), ("source_timestamp", time_ns))
    parts = [sized(key.encode()) + number.to_bytes(8, "little", signed=True) for key, number in numbers]
    return b"".join(parts) + sized(b"source_gid") + sized(gid)
