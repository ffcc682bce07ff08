"""Outputs beside the serial line, each as its bridge would find it. Nothing is sent.

A password is not tried: who logs in under a bridge's name may end what that has told.
"""

from __future__ import annotations

import grp
import shutil
import socket
import ssl
import stat
import time
from collections.abc import Iterator
from pathlib import Path

from ledpi.config.named_files import read_password, tls_context
from ledpi.config.outputs import OutputSettings
from ledpi.config.settings import Config
from ledpi.core.errors import ConfigError, LedpiError
from ledpi.core.wording import install_command
from ledpi.daemon.tap.of_config import CAMERAS, OF_ONE_CAMERA
from ledpi.links.factory import TARGETS, target_class
from ledpi.links.sockets import lost, refused
from ledpi.links.target import CONNECT_S
from ledpi.workshop.doctor.finding import Finding, bad, ok, unknown
from ledpi.workshop.doctor.machine import answer_of

GROUP = "ledpi"  # of the bridges' unit
SOON_S = 14 * 86400.0  # before its end a certificate is told of
SYSTEMCTL_S = 10.0


def examine(config: Config) -> Iterator[Finding]:
    """Each output's library, password file, target with its certificate, and unit."""
    for name, settings in config.outputs.items():
        found = f"output {name}"
        if (extra := "mavlink" if settings.format == "mavlink" else TARGETS[settings.kind][2]) is not None:
            yield _library(found, name, settings, extra)
        if settings.password_file is not None:
            yield _password(found, settings.password_file)
        if settings.host is not None:
            yield _target(found, settings)
            yield _unit(found, unit_of(name, config.file))


def unit_of(name: str, file: Path | None) -> str:
    """The bridge's service; of one of several cameras its name has the camera's, too."""
    of_several = file is not None and file.parent == CAMERAS and file.name != OF_ONE_CAMERA
    return f"ledpi-bridge@{file.stem}-{name}" if of_several and file is not None else f"ledpi-bridge@{name}"


def _library(found: str, name: str, settings: OutputSettings, extra: str) -> Finding:
    try:
        target_class(name, settings)
    except LedpiError as error:
        command = install_command(extra)
        return bad(found, str(error).removesuffix(f": {command}"), command)
    return ok(found, f"the packages of {extra} are installed")


def _password(found: str, path: Path) -> Finding:
    """As the service will read it, by its group."""
    try:
        read_password(path, ConfigError)
        status, members = path.stat(), grp.getgrnam(GROUP).gr_gid
    except LedpiError as error:
        said, _, remedy = str(error).partition("; ")
        return bad(found, said, remedy or f"sudo install -m 640 -g {GROUP} /dev/stdin {path}")
    except KeyError:
        return ok(found, f"{path}: a password (there is no group {GROUP} here, so no service)")
    if status.st_gid != members or not status.st_mode & stat.S_IRGRP:
        remedy = f"sudo chgrp {GROUP} {path} && sudo chmod 640 {path}"
        return bad(found, f"{path}: the service, of the group {GROUP}, may not read it", remedy)
    return ok(found, f"{path}: a password, for the group {GROUP} to read")


def _target(found: str, settings: OutputSettings) -> Finding:
    where = "{}:{}".format(*settings.address)
    try:
        if settings.kind == "udp":
            socket.getaddrinfo(*settings.address, type=socket.SOCK_DGRAM)
            return unknown(found, f"{where}: a known address; UDP does not tell whether somebody listens")
        with socket.create_connection(settings.address, CONNECT_S) as connection:
            if settings.tls:
                return _certificate(found, where, connection, settings)
    except ssl.SSLError as error:
        said = str(refused(where, error))
    except OSError as error:
        said = str(lost(where, error))
    except LedpiError as error:
        said = f"{error}; see ca_file"
    else:
        return ok(found, f"{where}: answers")
    what, _, remedy = said.partition("; ")
    return bad(found, what, remedy or "see host and port")


def _certificate(found: str, where: str, connection: socket.socket, settings: OutputSettings) -> Finding:
    with tls_context(settings.ca_file, ConfigError).wrap_socket(connection, server_hostname=settings.host) as encrypted:
        until_s = ssl.cert_time_to_seconds(str((encrypted.getpeercert() or {})["notAfter"]))
    until = time.strftime("%Y-%m-%d", time.gmtime(until_s))
    if until_s - time.time() < SOON_S:
        return bad(found, f"{where}: answers; its certificate ends on {until}", "renew it")
    return ok(found, f"{where}: answers; its certificate is good until {until}")


def _unit(found: str, unit: str) -> Finding:
    tool = shutil.which("systemctl")
    said = "no systemctl here" if tool is None else answer_of([tool, "is-enabled", unit], SYSTEMCTL_S)
    if said == "enabled":
        return ok(found, f"{unit} starts with this machine")
    if said == "disabled":
        return bad(found, f"{unit} does not start with this machine", f"sudo systemctl enable --now {unit}")
    return unknown(found, f"{unit}: {said}")
