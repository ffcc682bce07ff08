"""`kind: mqtt`: a broker (MQTT 3.1.1, by paho-mqtt). docs/outputs.md has the topics.

paho's own thread would queue what a slow broker does not take, and deliver it late. So there is none: the bridge's
thread drives the connection. The broker acknowledges each message (quality of service 1). While it is behind with that,
nothing is published, as what lies in its buffer is old when it is read.
"""

from __future__ import annotations

import json
import logging
import math
import socket
import ssl
import time
import uuid
from collections import deque
from contextlib import suppress
from typing import Any

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode

from ledpi.config.named_files import read_password, tls_context
from ledpi.config.outputs import OutputSettings
from ledpi.core.errors import shortened_name
from ledpi.daemon.reporting import event
from ledpi.daemon.tap.protocol import write_line
from ledpi.links.payload import JsonPayload, with_age, with_host
from ledpi.links.sockets import keep_nothing_old, lost, refused
from ledpi.links.target import CONNECT_S, UNANSWERED_MS, BridgeError, Line, TargetLostError

BEHIND_S = 0.1  # without an acknowledgement: the broker is behind, and the next frames are dropped
KEEPALIVE_S = 5  # a broker says after 1.5 times that that we are gone
# Why a broker refuses us, as paho names it of either version of MQTT: what a person has to see to, and what may pass.
REFUSED = {
    "Bad user name or password": "refuses the user or the password; see user and password_file",
    "Client identifier not valid": (
        "refuses the client identifier; set client_id to one that it takes, such as 1 to 23 letters and digits"
    ),
    "Not authorized": "does not let this user in; see user and password_file, and the broker's own lists",
}
LATER = {"Server unavailable": "is not available now; look at its log"}
MAX_PACKET_BYTES = 1 << 20  # that a broker may send: more than any setup, the largest of what it has for us
PUBLISH, WITH_QUALITY = 0x30, 0x06  # in the first byte of a packet: its type, and a quality of service above 0
GONE = "gone"  # the state that the broker tells if we end without a word

_log = logging.getLogger("ledpi.bridge")


class _Client(paho.Client):
    """paho's, bounded: by itself it keeps whatever a broker promises, up to 256 MB a packet, and 65,535 of them."""

    def _sock_recv(self, bufsize: int) -> bytes:
        if bufsize > MAX_PACKET_BYTES:
            raise _too_much(self, f"a packet of {bufsize:,} bytes; must have {MAX_PACKET_BYTES:,} at most")
        return super()._sock_recv(bufsize)

    def _packet_handle(self) -> MQTTErrorCode:
        command = self._in_packet["command"]
        if command & 0xF0 == PUBLISH and command & WITH_QUALITY:
            raise _too_much(self, "a message to be acknowledged, which nobody asked for")
        return super()._packet_handle()


def _too_much(client: paho.Client, what: str) -> TargetLostError:
    return TargetLostError(f"{client.host}:{client.port}: the broker sends {what}; is a broker at this port?")


class MqttTarget:
    """One broker."""

    def __init__(self, settings: OutputSettings) -> None:
        self._settings = settings
        self._where = "{}:{}".format(*settings.address)
        self._way = f"tls: {str(settings.tls).lower()}"
        self._topic = settings.base_topic
        # By chance, so that two bridges of one machine, or of machines of one name, do not throw each other out.
        self._client_id = settings.client_id or f"ledpi-bridge-{socket.gethostname()}-{uuid.uuid4().hex[:8]}"
        self._may_subscribe = True
        self._has_told_of_other = False
        self._setups: deque[bytes] = deque(maxlen=8)  # that we have told: the broker tells them to us, too
        self._payload = JsonPayload()
        self._password = None if settings.password_file is None else read_password(settings.password_file, BridgeError)
        self._client: paho.Client | None = None
        self._refused: str | None = None  # what the broker said to us; "": nothing is wrong
        self._waiting_s: dict[int, float] = {}  # messages without an acknowledgement, by number: sent when

    def open(self) -> None:
        self._client = client = self._new_client()
        try:
            client.connect(*self._settings.address, keepalive=KEEPALIVE_S)
            connection: Any = client.socket()
            keep_nothing_old(connection)
        except ssl.SSLError as error:
            raise refused(self._where, error) from None
        except ConnectionResetError:
            raise TargetLostError(f"{self._where}: closes the connection; is the port right for {self._way}?") from None
        except OSError as error:
            raise lost(self._where, error) from None
        try:
            self._await_welcome(client)
        except BaseException:
            connection.close()
            raise
        self._listen(client)

    def tell_setup(self, hello: Line) -> None:
        self._setups.append(write_line(with_host(hello)).rstrip())
        self._publish("setup", self._setups[-1], keep=True)

    def send(self, frame: Line, now_ns: int) -> bool:
        if not self._has_room():
            return False
        self._publish("frame", self._payload.frame(frame, now_ns)[0].rstrip())
        if frame["robot"] is not None:
            self._publish("robot", write_line(with_age(frame["robot"], now_ns)).rstrip())
        return True

    def send_robot(self, state: Line, now_ns: int) -> None:
        if self._has_room():
            self._publish("robot_state", self._payload.robot(state, now_ns)[0].rstrip())

    def tell_state(self, state: str, health: Line | None) -> None:
        if not self._has_room():
            return
        if health is not None:
            self._publish("health", write_line(with_host(health)).rstrip())
        self._publish("status", _status(state), keep=True)

    def tick(self) -> None:
        client = self._client
        assert client is not None
        if (code := client.loop(timeout=0.0)) != paho.MQTT_ERR_SUCCESS:
            raise TargetLostError(f"{self._where}: the connection is lost ({paho.error_string(code).rstrip('.')})")

    def close(self) -> None:
        client, self._client = self._client, None
        if client is not None and client.is_connected():
            client.publish(f"{self._topic}/status", _status(GONE), retain=True)
            client.disconnect()
            with suppress(TargetLostError):
                client.loop(timeout=0.0)

    def _new_client(self) -> paho.Client:
        client = _Client(
            CallbackAPIVersion.VERSION2, self._client_id, protocol=paho.MQTTv311, reconnect_on_failure=False
        )
        client.connect_timeout = CONNECT_S
        client.will_set(f"{self._topic}/status", _status(GONE), qos=1, retain=True)
        if self._settings.user is not None:
            client.username_pw_set(self._settings.user, self._password)
        if self._settings.tls:
            client.tls_set_context(tls_context(self._settings.ca_file, BridgeError))
        client.on_connect = self._hear_welcome
        client.on_publish = self._hear_acknowledgement
        client.on_subscribe = self._hear_subscribed
        client.on_message = self._hear_setup
        self._waiting_s = {}
        return client

    def _hear_welcome(self, client: paho.Client, data: object, flags: object, reason: Any, more: object) -> None:
        self._refused = str(reason) if reason.is_failure else ""

    def _hear_acknowledgement(
        self, client: paho.Client, data: object, number: int, reason: object, more: object
    ) -> None:
        self._waiting_s.pop(number, None)

    def _listen(self, client: paho.Client) -> None:
        """Asks for the setup that is kept on our topic, before ours replaces it, and for those that replace ours.

        Some brokers end the connection of who may not; then it is not asked again.
        """
        if self._may_subscribe:
            self._may_subscribe = False  # until it is answered
            client.subscribe(f"{self._topic}/setup", qos=0)

    def _hear_subscribed(self, client: paho.Client, data: object, number: int, reasons: object, more: object) -> None:
        self._may_subscribe = True

    def _hear_setup(self, client: paho.Client, data: object, message: paho.MQTTMessage) -> None:
        """Warns, once, of another robot: one of another name, or one that tells its setup while we tell ours."""
        own = socket.gethostname()
        try:
            other = json.loads(message.payload).get("host", own)
        except (ValueError, RecursionError, AttributeError):  # whatever anybody writes there
            return
        is_ours = other == own and (message.retain or message.payload in self._setups)
        if not is_ours and not self._has_told_of_other:
            self._has_told_of_other = True
            name = shortened_name(other) if other != own else f"another bridge, of a machine that is named {own} too,"
            said = f"{self._where}: has a setup of {name} there, this is {own}; give each its own topic"
            _log.warning(event("shared_topic", topic=self._topic, error=said))

    def _await_welcome(self, client: paho.Client) -> None:
        self._refused = None
        until_s = time.monotonic() + CONNECT_S
        while self._refused is None and time.monotonic() < until_s:
            if client.loop(timeout=0.05) not in (paho.MQTT_ERR_SUCCESS, paho.MQTT_ERR_CONN_REFUSED):
                break
        else:
            if self._refused is None:
                raise TargetLostError(
                    f"{self._where}: takes the connection and says nothing; is a broker at this port?"
                )
        why = "nothing that is known" if self._refused is None else self._refused
        if why in REFUSED:
            raise BridgeError(f"{self._where}: the broker {REFUSED[why]}")
        if why in LATER:
            raise TargetLostError(f"{self._where}: the broker {LATER[why]}")
        if why != "":
            raise TargetLostError(f"{self._where}: answers as no broker does; is the port right for {self._way}?")

    def _has_room(self) -> bool:
        self.tick()
        assert self._client is not None
        waited_s = time.monotonic() - min(self._waiting_s.values(), default=math.inf)
        if waited_s > UNANSWERED_MS / 1000:
            raise TargetLostError(f"{self._where}: the broker does not answer")
        return waited_s < BEHIND_S and not self._client.want_write()

    def _publish(self, topic: str, data: bytes, *, keep: bool = False) -> None:
        """`keep`: the broker tells it to whoever comes later, too; so nothing that grows old."""
        client = self._client
        assert client is not None
        sent_s = time.monotonic()
        done = client.publish(f"{self._topic}/{topic}", data, qos=1, retain=keep)
        self._waiting_s[done.mid] = sent_s
        if done.rc != paho.MQTT_ERR_SUCCESS:
            raise TargetLostError(f"{self._where}: the connection is lost ({paho.error_string(done.rc).rstrip('.')})")


def _status(state: str) -> bytes:
    return json.dumps({"state": state, "unix_ns": time.time_ns()} if state != GONE else {"state": state}).encode()
