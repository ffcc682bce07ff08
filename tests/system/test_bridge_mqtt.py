"""An MQTT bridge and a broker that asks for a password, over TLS: what is told, and what a person has to put right."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import threading
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from tests.builders import ROOT
from tests.builders.bridges import LEDPI, MOSQUITTO, PASSWORD, Mqtt, Secure, bridge, secrets
from tests.builders.made_up_daemon import MadeUpDaemon
from tests.builders.waiting import limit_s, wait_until

pytestmark = pytest.mark.skipif(
    MOSQUITTO is None or shutil.which("openssl") is None or shutil.which("mosquitto_passwd") is None,
    reason="mosquitto or openssl is not installed",
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """With certificates and a password."""
    secrets(tmp_path)
    return tmp_path


@pytest.fixture
def broker(folder: Path) -> Iterator[Mqtt]:
    far = Secure(folder, "broker.pem")
    far.start()
    yield far
    far.close()


@pytest.fixture
def daemon(folder: Path) -> Iterator[MadeUpDaemon]:
    made_up = MadeUpDaemon(folder / "tap.sock", numbered=True)
    yield made_up
    made_up.close()


def states(broker: Mqtt) -> list[str]:
    """That were told, in order."""
    return [json.loads(data)["state"] for topic, data, _ in broker.messages if topic == "ledpi/status"]


def test_the_broker_is_told_everything_and_no_secret(broker: Mqtt, daemon: MadeUpDaemon, folder: Path) -> None:
    """Frames, health, setup and status; nowhere the password."""
    with bridge(broker.settings, folder / "tap.sock", folder) as running:
        wait_until(lambda: len(broker.frames) > 10)
        wait_until(lambda: {"ledpi/health", "ledpi/setup"} <= {topic for topic, _, _ in broker.messages})
        setup = next(json.loads(data) for topic, data, _ in broker.messages if topic == "ledpi/setup")
        assert setup["panels"]["side_m"] == 0.16
        assert states(broker)[-1] == "running"
        assert PASSWORD not in running.log
        assert not any(PASSWORD.encode() in data for _, data, _ in broker.messages)
        for what in ("cmdline", "environ"):  # as `ps` shows them
            assert PASSWORD.encode() not in Path(f"/proc/{running.process.pid}/{what}").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("command", [("config", "show"), ("doctor",), ("backup", "robot.ledpi")])
def test_no_command_shows_the_password(command: tuple[str, ...], broker: Mqtt, folder: Path) -> None:
    """Nor does a backup hold it: the file that has it stays where it is."""
    outputs = json.dumps({"far": broker.settings})
    config, (*words, last) = folder / "config.yaml", command
    config.write_text(f"panels: {{side_m: 0.16}}\nserial: {{port: null}}\noutputs: {outputs}\n", encoding="utf-8")
    last = str(folder / last) if last == "robot.ledpi" else last
    asked = [*LEDPI, *words, last, "--config", str(config)]
    done = subprocess.run(asked, cwd=folder, capture_output=True, text=True, timeout=limit_s(30), check=False)
    assert "Traceback" not in done.stderr
    assert len(done.stdout) > 20
    assert PASSWORD not in done.stdout + done.stderr
    if command[0] == "doctor":
        assert f"localhost:{broker.port}" in done.stdout
    elif command[0] == "backup":
        with zipfile.ZipFile(folder / "robot.ledpi") as archive:
            assert not any(PASSWORD.encode() in archive.read(name) for name in archive.namelist())


@pytest.mark.slow
def test_who_was_killed_is_told_of(broker: Mqtt, daemon: MadeUpDaemon, folder: Path) -> None:
    """The daemon by the bridge, which waits for another; the bridge by its last will, kept for whoever comes later."""
    with bridge(broker.settings, folder / "tap.sock", folder) as running:
        wait_until(lambda: len(broker.frames) > 3)
        daemon.close()
        wait_until(lambda: states(broker)[-1] == "no_daemon")
        running.process.kill()
        wait_until(lambda: states(broker)[-1] == "gone")


def refusal(values: dict[str, Any], folder: Path) -> str:
    """The last line of a bridge that ends with status 2."""
    outputs = f"outputs={json.dumps({'far': values})}"
    command = [*LEDPI, "bridge", "far", "--set", outputs, "--set", f"tap.socket={folder}/tap.sock"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=limit_s(30), check=False)
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr.splitlines()[-1]


@pytest.mark.slow
def test_a_wrong_password_ends_it(broker: Mqtt, folder: Path) -> None:
    """With the keys to look at, and without the password."""
    (folder / "password").write_text("battery-staple\n", encoding="utf-8")
    said = refusal(broker.settings, folder)
    assert f"localhost:{broker.port}: the broker" in said
    assert "see user and password_file" in said
    assert "battery-staple" not in said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("certificate", "says"), [("ended.pem", "certificate has expired"), ("other.pem", "is not valid for 'localhost'")]
)
def test_a_certificate_of_another_time_or_name_ends_it(folder: Path, certificate: str, says: str) -> None:
    """It says that it has expired, or which name was asked for."""
    far = Secure(folder, certificate)
    far.subscriber = object()
    far.start()
    try:
        said = refusal(far.settings, folder)
    finally:
        far.vanish()
    assert says in said
    assert said.endswith("renew it, or see host and ca_file")


@pytest.mark.slow
def test_a_port_without_tls_is_told_of(daemon: MadeUpDaemon, folder: Path) -> None:
    """A plain broker only closes the connection, as one does that is restarted: it is tried again."""
    values, far = Secure(folder).settings, Mqtt(folder)  # which writes its own configuration over the other's
    far.start()
    try:
        with bridge(values | {"port": far.port}, folder / "tap.sock", folder) as running:
            wait_until(lambda: "closes the connection; is the port right for tls: true?" in running.log)
    finally:
        far.close()


@pytest.mark.slow
def test_a_certificate_that_signs_itself_ends_it_until_it_is_the_ca_file(daemon: MadeUpDaemon, folder: Path) -> None:
    """As a small broker has it."""
    far = Secure(folder, "self.pem")
    far.subscriber = object()
    far.start()
    try:
        assert "its certificate is not accepted (self" in refusal(far.settings, folder)
        trusting = far.settings | {"ca_file": f"{folder}/self.pem"}
        with bridge(trusting, folder / "tap.sock", folder) as running:
            wait_until(lambda: "target_open" in running.log)
    finally:
        far.vanish()


HTTP = b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n"
ANSWERS = {
    "HTTP": (HTTP, "answers as no broker does; is the port right for tls: false?"),
    "nothing": (None, "takes the connection and says nothing; is a broker at this port?"),
    "256 MB": (b"\x20\xff\xff\xff\x7f", "the broker sends a packet of 268,435,455 bytes; must have 1,048,576 at most"),
}


@pytest.mark.slow
@pytest.mark.parametrize("what", ANSWERS)
def test_who_is_no_broker_is_told_of_and_tried_again(what: str, folder: Path) -> None:
    """Each as what it is, in one line; it may be that the right one is started later."""
    answer, said = ANSWERS[what]
    with answering(answer) as port:
        values = {"kind": "mqtt", "host": "127.0.0.1", "port": port}
        with bridge(values, folder / "tap.sock", folder) as running:
            wait_until(lambda: said in running.log)
            wait_until(lambda: running.process.poll() is None)
            assert running.log.count("target_lost") == 1


@pytest.mark.slow
def test_robots_on_one_broker_are_told_apart(daemon: MadeUpDaemon, folder: Path) -> None:
    """By topic, host and identifier; who shares a topic is told, and who is refused by its identifier too."""
    far, own = Mqtt(folder, "allow_anonymous true", "allow_zero_length_clientid false"), socket.gethostname()
    topic = f"ledpi/{own}"
    far.start()
    try:
        values = {"kind": "mqtt", "host": "127.0.0.1", "port": far.port}
        with bridge(values, folder / "tap.sock", folder) as running:
            wait_until(lambda: f"{topic}/setup" in [name for name, _, _ in far.messages])
            far.subscriber.publish(f"{topic}/setup", json.dumps({"host": own}))
            wait_until(lambda: f"of a machine that is named {own} too" in running.log)
        far.subscriber.publish(f"{topic}/setup", '{"host": "other"}', retain=True)
        wait_until(lambda: b'{"host": "other"}' in [data for _, data, _ in far.messages])
        with bridge(values, folder / "tap.sock", folder) as running:
            told = {f"{topic}/{what}" for what in ("setup", "frame", "health")}
            wait_until(lambda: told <= {name for name, data, _ in far.messages if json.loads(data).get("host") == own})
            wait_until(lambda: "has a setup of other there" in running.log)
    finally:
        far.close()
    with answering(b"\x20\x02\0\2") as port:
        assert "the broker refuses the client identifier; set client_id" in refusal(values | {"port": port}, folder)


@pytest.mark.slow
def test_a_broker_fills_no_memory_with_what_nobody_asked_for(folder: Path) -> None:
    """Messages that must be acknowledged twice would be kept until then."""
    with (
        answering(b"\x20\x02\0\0" + b"\x34\x05\0\1a\0\1") as port,
        bridge({"kind": "mqtt", "host": "127.0.0.1", "port": port}, folder / "tap.sock", folder) as running,
    ):
        wait_until(lambda: "the broker sends a message to be acknowledged, which nobody asked for" in running.log)


@contextmanager
def answering(data: bytes | None) -> Iterator[int]:
    """A port that answers each connection's first words with these, and closes it; or with nothing, and keeps it."""
    taken: list[socket.socket] = []

    def serve() -> None:
        with suppress(OSError):
            while True:
                connection, _ = listener.accept()
                taken.append(connection)
                if data is not None:
                    connection.recv(4096)
                    connection.sendall(data)
                    connection.close()

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield int(listener.getsockname()[1])
        listener.shutdown(socket.SHUT_RDWR)
        thread.join()
    for connection in taken:
        connection.close()
