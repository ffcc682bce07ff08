"""Findings of `ledpi doctor` on `outputs`: real servers on this machine, and the system's `systemctl` played."""

from __future__ import annotations

import grp
import os
import socket
import ssl
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from ledpi.config.settings import load_config
from ledpi.workshop.doctor import checks
from ledpi.workshop.doctor.finding import Finding
from tests.builders.bridges import free_port
from tests.builders.certificates import certificates, needs_openssl

SYSTEMCTL = '#!/bin/sh\n[ "$1 $2" = "is-enabled {unit}" ] && echo {said}\n'


@pytest.fixture(autouse=True)
def _no_systemd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Unless a test has one of its own."""
    (tmp_path / "bin").mkdir()
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))


def found(*settings: str, file: Path | None = None) -> list[Finding]:
    """Returns those of an output `field` with these settings."""
    given = f"outputs={{field: {{{', '.join(settings)}}}}}"
    return list(checks.examine_outputs(load_config(file, ("panels.side_m=1", given))))


def target(*settings: str) -> Finding:
    """The line before that of the unit."""
    return found(*settings)[-2]


@contextmanager
def server(context: ssl.SSLContext | None = None) -> Iterator[int]:
    """One that takes connections at a port, and speaks TLS where it has a context."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            with suppress(OSError):
                while True:
                    connection, _ = listener.accept()
                    with suppress(OSError), connection:
                        if context is not None:
                            context.wrap_socket(connection, server_side=True).close()

        thread = threading.Thread(target=serve)
        thread.start()
        yield listener.getsockname()[1]
        listener.shutdown(socket.SHUT_RDWR)
        thread.join()


def test_a_target_that_answers_is_well() -> None:
    """Whatever it is."""
    with server() as port:
        one = target("kind: tcp", "host: 127.0.0.1", f"port: {port}")
    assert (one.name, one.state, one.said) == ("output field", "ok", f"127.0.0.1:{port}: answers")
    package, *_ = found("kind: mqtt", "host: 127.0.0.1", "port: 1")
    assert (package.state, package.said) == ("ok", "the packages of mqtt are installed")


@pytest.mark.parametrize(
    ("host", "said", "remedy"),
    [
        ("127.0.0.1", "nothing listens there", "is it started, and the port right?"),
        ("no-such-host.invalid", "no machine of that name is known", "is host right?"),
    ],
)
def test_one_that_does_not_answer_is_told_with_what_to_look_at(host: str, said: str, remedy: str) -> None:
    """And stops no daemon."""
    one = target("kind: tcp", f"host: {host}", f"port: {free_port()}")
    assert (one.state, one.remedy, one.stops_daemon) == ("bad", remedy, False)
    assert said in one.said


def test_nobody_answers_over_udp() -> None:
    """So it is not known."""
    assert target("kind: udp", "host: 127.0.0.1", "port: 5005").state == "unknown"


def test_a_pipe_needs_nothing() -> None:
    """Nor is it a service."""
    assert found("kind: stdout") == []


def test_a_package_that_is_missing_is_told_with_its_command(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where only `pip install ledpi` was done."""
    monkeypatch.delitem(sys.modules, "ledpi.links.mqtt", raising=False)
    monkeypatch.setitem(sys.modules, "paho", None)
    one = found("kind: mqtt", "host: 127.0.0.1")[0]
    assert one.state == "bad"
    assert one.said.startswith("outputs.field: kind mqtt needs the package paho")
    assert one.remedy.endswith("pip install 'ledpi[mqtt]'")


def secret(tmp_path: Path, mode: int, text: str = "correct-horse\n") -> Finding:
    """Returns what is said of a password's file."""
    path = tmp_path / "password"
    path.write_text(text, encoding="utf-8")
    path.chmod(mode)
    return found("kind: mqtt", "host: 127.0.0.1", "user: robot", f"password_file: {path}")[1]


@pytest.mark.parametrize(
    ("mode", "text", "said", "remedy"),
    [
        (0o644, "correct-horse\n", "everybody may read it", "chmod o-r, and let the group ledpi read it"),
        (0o640, "", "is empty", "its first line must be the password"),
    ],
)
def test_a_password_that_is_none_or_everybodys_is_told(
    tmp_path: Path, mode: int, text: str, said: str, remedy: str
) -> None:
    """It is never shown."""
    one = secret(tmp_path, mode, text)
    assert (one.state, one.remedy) == ("bad", remedy)
    assert said in one.said


def test_a_password_that_is_missing_is_told_with_what_makes_one() -> None:
    """As docs/outputs.md has it."""
    one = found("kind: mqtt", "host: 127.0.0.1", "user: robot", "password_file: /nowhere/password")[1]
    assert one.state == "bad"
    assert one.remedy == "sudo install -m 640 -g ledpi /dev/stdin /nowhere/password"


@pytest.mark.parametrize(("mode", "state"), [(0o640, "ok"), (0o600, "bad")])
def test_the_services_group_must_be_able_to_read_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: int, state: str
) -> None:
    """Whoever asks the doctor: root may read all."""
    monkeypatch.setattr(checks, "GROUP", grp.getgrgid(os.getgid()).gr_name)
    one = secret(tmp_path, mode)
    assert one.state == state
    assert "correct-horse" not in one.said + one.remedy


@pytest.fixture
def authority(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with certificates."""
    with monkeypatch.context() as patch:
        patch.setenv("PATH", os.defpath)
        certificates(tmp_path)
    return tmp_path


def tls(folder: Path, certificate: str, ca_file: str | None = "ca.pem") -> Finding:
    """Returns what is said of a server that shows this certificate."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(folder / certificate, folder / "broker.key")
    given = () if ca_file is None else (f"ca_file: {folder / ca_file}",)
    with server(context) as port:
        return target("kind: mqtt", "host: localhost", f"port: {port}", "tls: true", *given)


@needs_openssl
def test_a_certificate_is_told_with_its_end(authority: Path) -> None:
    """A month from now."""
    one = tls(authority, "broker.pem")
    assert one.state == "ok"
    assert "its certificate is good until 20" in one.said


@needs_openssl
def test_a_certificate_that_ends_soon_is_told(authority: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before it stops the bridge."""
    monkeypatch.setattr(checks, "SOON_S", 40 * 86400.0)
    one = tls(authority, "broker.pem")
    assert (one.state, one.remedy) == ("bad", "renew it")


@needs_openssl
@pytest.mark.parametrize(
    ("certificate", "ca_file", "said"),
    [
        ("ended.pem", "ca.pem", "certificate has expired"),
        ("broker.pem", None, "certificate is not accepted"),
        ("broker.pem", "broker.key", "no certificates can be read from it"),
    ],
)
def test_a_certificate_that_is_not_accepted_is_told(
    authority: Path, certificate: str, ca_file: str | None, said: str
) -> None:
    """Ended, of another authority, or an authority that is none."""
    one = tls(authority, certificate, ca_file)
    assert one.state == "bad"
    assert said in one.said
    assert one.remedy


@needs_openssl
def test_a_server_without_tls_is_told(authority: Path) -> None:
    """It closes the connection."""
    with server() as port:
        one = target("kind: mqtt", "host: localhost", f"port: {port}", "tls: true", f"ca_file: {authority / 'ca.pem'}")
    assert (one.state, bool(one.remedy)) == ("bad", True)


@pytest.mark.parametrize(("said", "state"), [("enabled", "ok"), ("disabled", "bad"), ("not-found", "unknown")])
def test_whether_the_service_starts_with_the_machine_is_told(tmp_path: Path, said: str, state: str) -> None:
    """With what would make it."""
    tool = tmp_path / "bin/systemctl"
    tool.write_text(SYSTEMCTL.format(unit="ledpi-bridge@field", said=said), encoding="utf-8")
    tool.chmod(0o755)
    one = found("kind: udp", "host: 127.0.0.1", "port: 5005")[-1]
    assert (one.state, "ledpi-bridge@field" in one.said) == (state, True)
    assert one.remedy == ("sudo systemctl enable --now ledpi-bridge@field" if state == "bad" else "")


def test_of_several_cameras_each_has_its_own_service(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Named as docs/outputs.md names it."""
    monkeypatch.setattr(checks, "CAMERAS", tmp_path)
    assert checks.unit_of("field", tmp_path / "front.yaml") == "ledpi-bridge@front-field"
    assert checks.unit_of("field", tmp_path / "config.yaml") == "ledpi-bridge@field"
    assert checks.unit_of("field", None) == "ledpi-bridge@field"
