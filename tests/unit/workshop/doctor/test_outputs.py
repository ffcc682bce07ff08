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
    assert target("kind: udp", "host: 127.0.0.1", "port: 5005").state == "unknown"  # nobody answers over UDP


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


@pytest.mark.parametrize(
    ("mode", "text", "state", "said", "remedy"),
    [
        (0o640, "correct-horse\n", "ok", "", ""),
        (0o644, "correct-horse\n", "bad", "everybody may read it", "chmod o-r, and let the group ledpi read it"),
        (0o600, "correct-horse\n", "bad", "", "sudo chgrp {group} {path} && sudo chmod 640 {path}"),
        (0o640, "", "bad", "is empty", "its first line must be the password"),
        (None, "", "bad", "", "sudo install -m 640 -g ledpi /dev/stdin {path}"),  # as docs/outputs.md has it
    ],
    ids=["good", "everybody's", "not the group's", "empty", "missing"],
)
def test_a_password_must_be_there_and_the_services_groups(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: int | None, text: str, state: str, said: str, remedy: str
) -> None:
    """Whoever asks the doctor: root may read all. It is never shown."""
    group, path = grp.getgrgid(os.getgid()).gr_name, tmp_path / "password"
    if mode is not None:
        monkeypatch.setattr(checks, "GROUP", group)
        path.write_text(text, encoding="utf-8")
        path.chmod(mode)
    one = found("kind: mqtt", "host: 127.0.0.1", "user: robot", f"password_file: {path}")[1]
    assert (one.state, one.remedy) == (state, remedy.format(group=group, path=path))
    assert said in one.said
    assert "correct-horse" not in one.said


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
@pytest.mark.parametrize(
    ("certificate", "ca_file", "soon_days", "state", "said"),
    [
        ("broker.pem", "ca.pem", 14, "ok", "its certificate is good until 20"),  # it has a month
        ("broker.pem", "ca.pem", 40, "bad", "its certificate"),
        ("ended.pem", "ca.pem", 14, "bad", "certificate has expired"),
        ("broker.pem", None, 14, "bad", "certificate is not accepted"),
        ("broker.pem", "broker.key", 14, "bad", "no certificates can be read from it"),
    ],
    ids=["good", "ends soon", "ended", "of another authority", "no authority"],
)
def test_a_certificate_is_told_with_its_end(
    authority: Path,
    monkeypatch: pytest.MonkeyPatch,
    certificate: str,
    ca_file: str | None,
    soon_days: int,
    state: str,
    said: str,
) -> None:
    """Before it stops the bridge; one that is not accepted, with a remedy."""
    monkeypatch.setattr(checks, "SOON_S", soon_days * 86400.0)
    one = tls(authority, certificate, ca_file)
    assert (one.state, bool(one.remedy)) == (state, state == "bad")
    assert said in one.said


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
