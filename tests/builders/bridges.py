"""The far ends of bridges, real ones: sockets, a pipe, mosquitto, an ntcore server in a process of its own."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ledpi.links.target import Target, TargetLostError
from tests.builders import ROOT
from tests.builders.certificates import certificates
from tests.builders.waiting import limit_s, wait_until

LEDPI = [sys.executable, "-m", "ledpi"]
PASSWORD = "correct-horse"
MOSQUITTO = shutil.which("mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin")


class Far:
    """A far end. `settings`: what `outputs` holds to reach it."""

    kind = ""
    tells_age = True  # as it was when the frame was sent; else it is taken when the frame has come

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.frames: list[tuple[int, int, int]] = []  # when (CLOCK_MONOTONIC ns), seq, and age in µs as it was told

    @property
    def settings(self) -> dict[str, Any]:
        return {"kind": self.kind, "host": "127.0.0.1", "port": self.port}

    port = 0

    def start(self) -> None:
        """Comes up, at the same place each time."""

    def vanish(self) -> None:
        """Goes, as if killed."""

    def block(self) -> None:
        """Stays connected, and takes nothing."""

    def unblock(self) -> None:
        """Takes what comes again."""

    def send_garbage(self) -> None:
        """Says what nobody asked for."""

    def close(self) -> None:
        self.vanish()

    def take(self, line: bytes) -> None:
        values = json.loads(line)
        if values["type"] == "decoded":
            self.frames.append((time.monotonic_ns(), values["seq"], values["age_us"]))


def free_port(kind: int = socket.SOCK_STREAM) -> int:
    """A port that nobody has now, of those that the system gives to nobody who does not ask for them."""
    while True:
        with socket.socket(socket.AF_INET, kind) as probe, suppress(OSError):
            probe.bind(("127.0.0.1", random.SystemRandom().randrange(20_000, 32_768)))
            return int(probe.getsockname()[1])


def is_open(target: Target) -> bool:
    """Tells whether the far end answers by now."""
    try:
        target.open()
    except TargetLostError:
        return False
    return True


class Udp(Far):
    kind = "udp"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.port = free_port(socket.SOCK_DGRAM)

    def start(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", self.port))
        self._socket.settimeout(0.05)
        self._alive, self._free = True, threading.Event()
        self._free.set()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        while self._alive:
            self._free.wait()
            with suppress(TimeoutError, OSError):
                data, self._from = self._socket.recvfrom(1 << 16)
                self.take(data)

    def vanish(self) -> None:
        self._alive = False
        self._free.set()
        self._thread.join()
        self._socket.close()

    def block(self) -> None:
        self._free.clear()

    def unblock(self) -> None:
        self._free.set()

    def send_garbage(self) -> None:
        self._socket.sendto(os.urandom(1000), self._from)


class Tcp(Far):
    kind = "tcp"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.port = free_port()

    def start(self) -> None:
        self._listener = socket.socket()
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
        self._listener.bind(("127.0.0.1", self.port))
        self._listener.listen()
        self._connection: socket.socket | None = None
        self._alive, self._free = True, threading.Event()
        self._free.set()
        self._thread = threading.Thread(target=self._accept, daemon=True)
        self._thread.start()

    def _accept(self) -> None:
        with suppress(OSError):
            while self._alive:
                self._connection, _ = self._listener.accept()
                with self._connection:
                    self._connection.settimeout(0.05)
                    self._read(self._connection)

    def _read(self, connection: socket.socket) -> None:
        data = b""
        while self._alive:
            self._free.wait()
            try:
                new = connection.recv(1 << 16)
            except TimeoutError:
                continue
            except OSError:
                return
            if not new:
                return
            *lines, data = (data + new).split(b"\n")
            for line in lines:
                self.take(line)

    def vanish(self) -> None:
        self._alive = False
        self._free.set()
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join()

    def block(self) -> None:
        self._free.clear()

    def unblock(self) -> None:
        self._free.set()

    def send_garbage(self) -> None:
        assert self._connection is not None
        with suppress(OSError):
            self._connection.sendall(os.urandom(1000))


class Mqtt(Far):
    """A mosquitto, and a subscriber."""

    kind = "mqtt"

    def __init__(self, folder: Path, *lines: str) -> None:
        super().__init__(folder)
        self.port = free_port()
        self.messages: list[tuple[str, bytes, bool]] = []
        self._config = folder / "mosquitto.conf"
        own_user = ("user root",) if os.geteuid() == 0 else ()  # else it would go on as one that may not read here
        text = "\n".join(
            (*own_user, f"listener {self.port} 127.0.0.1", *(lines or ("allow_anonymous true",)), "persistence false")
        )
        self._config.write_text(text + "\n", encoding="utf-8")
        self.subscriber: Any = None

    @property
    def settings(self) -> dict[str, Any]:
        return super().settings | {"topic": "ledpi"}

    def start(self) -> None:
        assert MOSQUITTO is not None
        self._broker = subprocess.Popen(
            [MOSQUITTO, "-c", str(self._config)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        wait_until(lambda: _listens(self.port))
        if self.subscriber is None:
            self._subscribe()

    def _subscribe(self) -> None:
        import paho.mqtt.client as paho
        from paho.mqtt.enums import CallbackAPIVersion

        self.subscriber = client = paho.Client(CallbackAPIVersion.VERSION2)
        client.reconnect_delay_set(0.05, 0.2)  # type: ignore[arg-type]
        client.on_message = lambda _c, _d, message: self._hear(message)
        client.on_connect = lambda *_: client.subscribe("ledpi/#")
        self.prepare(client)
        client.connect("127.0.0.1", self.port)
        client.loop_start()
        wait_until(client.is_connected)

    def prepare(self, client: Any) -> None:
        """For brokers that want a password."""

    def _hear(self, message: Any) -> None:
        self.messages.append((message.topic, message.payload, message.retain))
        if message.topic == "ledpi/frame":
            self.take(message.payload)

    def vanish(self) -> None:
        self._broker.send_signal(signal.SIGCONT)
        self._broker.kill()
        self._broker.wait()

    def block(self) -> None:
        self._broker.send_signal(signal.SIGSTOP)

    def unblock(self) -> None:
        self._broker.send_signal(signal.SIGCONT)

    def close(self) -> None:
        if self.subscriber is not None:
            self.subscriber.loop_stop()
        self.vanish()


class Secure(Mqtt):
    """A broker with TLS and a password, in a folder with `secrets`."""

    def __init__(self, folder: Path, certificate: str = "broker.pem") -> None:
        files = (f"cafile {folder}/ca.pem", f"certfile {folder}/{certificate}", f"keyfile {folder}/broker.key")
        super().__init__(folder, *files, "allow_anonymous false", f"password_file {folder}/users")

    @property
    def settings(self) -> dict[str, Any]:
        values = {
            "kind": "mqtt",
            "host": "localhost",
            "port": self.port,
            "topic": "ledpi",
            "tls": True,
            "user": "robot",
        }
        return values | {"ca_file": f"{self.folder}/ca.pem", "password_file": f"{self.folder}/password"}

    def prepare(self, client: Any) -> None:
        client.tls_set(str(self.folder / "ca.pem"))
        client.tls_insecure_set(True)  # the ended certificate is looked at, too
        client.username_pw_set("robot", PASSWORD)


def secrets(folder: Path) -> None:
    """Makes certificates, and the password for both sides."""
    certificates(folder)
    command = ["mosquitto_passwd", "-b", "-c", "users", "robot", PASSWORD]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    (folder / "password").write_text(PASSWORD + "\n", encoding="utf-8")
    (folder / "password").chmod(0o600)


class InProcess(Far):
    """A far end in a process of its own, which prints a line of JSON for each frame that it gets."""

    program = ""
    tells_age = False

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.port = free_port()

    def start(self) -> None:
        command = [sys.executable, "-c", self.program, str(self.port)]
        self._process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "ready\n"
        self._thread = threading.Thread(target=self._read, args=(self._process,), daemon=True)
        self._thread.start()

    def _read(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            self.hear(json.loads(line))

    def hear(self, values: dict[str, Any]) -> None:
        self.frames.append((values["at_ns"], values["seq"], values["age_us"]))

    def vanish(self) -> None:
        self._process.kill()
        self._process.wait()
        self._thread.join()
        assert self._process.stdout is not None
        self._process.stdout.close()

    def block(self) -> None:
        self._process.send_signal(signal.SIGSTOP)

    def unblock(self) -> None:
        self._process.send_signal(signal.SIGCONT)


class Nt(InProcess):
    """An ntcore server. It takes the frame's number from the panel's pose."""

    kind = "nt"
    program = """
import json, struct, sys, time
import ntcore

server = ntcore.NetworkTableInstance.create()
server.startServer("", "127.0.0.1", 0, int(sys.argv[1]))
options = ntcore.PubSubOptions(periodic=0.005, sendAll=True, keepDuplicates=True, pollStorage=1000)
poses = server.getRawTopic("/ledpi/panels/7/pose").subscribe("struct:Pose3d", b"", options)
while server.getNetworkMode() == ntcore.NetworkTableInstance.NetworkMode.kNetModeStarting:
    time.sleep(0.01)
print("ready", flush=True)
while True:
    for value in poses.readQueue():
        now_us = ntcore._now()
        y = struct.unpack("<7d", value.value)[1]  # to the left, in WPILib's frame
        line = {"at_ns": time.monotonic_ns(), "seq": round(-y * 1000), "age_us": now_us - value.time}
        print(json.dumps(line), flush=True)
    time.sleep(0.001)
"""


# The beginning of a program: a router at the port that it is given, and ROS 2's own types.
ZENOH_ROUTER = """
import json, sys, time
import zenoh
from rosbags.typesys import Stores, get_typestore

config = zenoh.Config()
config.insert_json5("mode", json.dumps("router"))
config.insert_json5("listen/endpoints", json.dumps([f"tcp/127.0.0.1:{sys.argv[1]}"]))
config.insert_json5("scouting/multicast/enabled", "false")
session = zenoh.open(config)
types = get_typestore(Stores.ROS2_JAZZY)
"""


class Zenoh(InProcess):
    """A router, and a participant that knows rmw_zenoh's names and ROS 2's own types only."""

    kind = "zenoh"
    program = (
        ZENOH_ROUTER
        + """
kind = "geometry_msgs/msg/PoseWithCovarianceStamped"


def hear(sample):
    message = types.deserialize_cdr(bytes(sample.payload), kind)
    stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
    line = {"at_ns": time.monotonic_ns(), "seq": round(message.pose.pose.position.x * 1000)}
    line["age_us"] = (time.time_ns() - stamp_ns) // 1000
    print(json.dumps(line), flush=True)


name = f"geometry_msgs::msg::dds_::PoseWithCovarianceStamped_/{types.hash_rihs01(kind)}"
subscriber = session.declare_subscriber(f"0/ledpi/panel_7/{name}", hear)
print("ready", flush=True)
time.sleep(1e6)
"""
    )


class Stdout(Far):
    """The pipe of the bridge's own process."""

    kind = "stdout"

    @property
    def settings(self) -> dict[str, Any]:
        return {"kind": "stdout"}

    def start(self) -> None:
        self._free = threading.Event()
        self._free.set()

    def read(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            self._free.wait()
            self.take(line)

    def block(self) -> None:
        self._free.clear()

    def unblock(self) -> None:
        self._free.set()

    def close(self) -> None:
        self._free.set()


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


class Running:
    """`ledpi bridge far`."""

    def __init__(self, process: subprocess.Popen[bytes], log: Path) -> None:
        self.process, self._log = process, log

    @property
    def log(self) -> str:
        return self._log.read_text(encoding="utf-8")

    def end(self) -> dict[str, int]:
        """Its counters, after SIGTERM."""
        self.process.terminate()
        assert self.process.wait(limit_s()) == 0, self.log
        last = [line for line in self.log.splitlines() if " bridge output=" in line][-1]
        return {key: int(number) for key, number in (part.split("=") for part in last.split()[3:])}


@contextmanager
def bridge(
    settings: dict[str, Any],
    tap: Path,
    folder: Path,
    read: Callable[..., None] | None = None,
    max_age_ms: int = 100,
    before: Sequence[str] = (),
) -> Iterator[Running]:
    """`settings`: of `outputs.far`. `read` gets its standard output. `before`: of the command, as `nice`."""
    given = (f"outputs={json.dumps({'far': settings})}", f"tap.socket={tap}", f"serial.max_age_ms={max_age_ms}")
    command = [*before, *LEDPI, "bridge", "far", *(part for item in given for part in ("--set", item))]
    log = folder / "bridge.log"
    with log.open("w") as errors:
        process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=errors)
    reader = None if read is None else threading.Thread(target=read, args=(process,), daemon=True)
    if reader is not None:
        reader.start()
    try:
        yield Running(process, log)
    except BaseException:
        print(log.read_text(encoding="utf-8"))
        raise
    finally:
        process.kill()
        process.wait()
        if reader is not None:
            reader.join(limit_s())
        assert process.stdout is not None
        process.stdout.close()
