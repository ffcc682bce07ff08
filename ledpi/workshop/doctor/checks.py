"""All checks, in the order of the page; of the outputs each as its bridge would find it, and nothing is sent.

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

from ledpi.config.check import load_own_map, unreadable_note
from ledpi.config.named_files import read_password, tls_context
from ledpi.config.outputs import OutputSettings
from ledpi.config.settings import SEARCH_PATH, Config, SerialSettings
from ledpi.core.codewords import format_ranges
from ledpi.core.errors import ConfigError, LedpiError, WireError
from ledpi.core.wording import counted, install_command, one_line
from ledpi.daemon.tap.places import CAMERAS, OF_ONE_CAMERA
from ledpi.links.bridge import TARGETS, target_class
from ledpi.links.sockets import lost, refused
from ledpi.links.target import CONNECT_S
from ledpi.workshop.doctor import camera, machine, ports, running
from ledpi.workshop.doctor.finding import Finding, bad, ok, unknown
from ledpi.workshop.doctor.machine import answer_of


def configuration(file: Path | None, *, asked_for: bool) -> Finding:
    """Which one is read. In a clone of the repository that is the clone's, whatever was written to the service's."""
    service = SEARCH_PATH[-1]
    if file is None:
        return ok("configuration", "from --set alone")
    if asked_for or not service.is_file() or file.samefile(service):
        return ok("configuration", str(file))
    said = f"{file} of this folder; the service reads {service}"
    remedy = f"to use the service's: leave this folder, or give --config {service}"
    return unknown("configuration", said, remedy)


def examine(config: Config, *, is_given: bool = True) -> Iterator[Finding]:
    """Each finding as soon as it is known; the camera takes some seconds, and the speed.

    Without `is_given` there is no configuration, and these are the defaults: a daemon is asked whatever it runs with.
    """
    kind, _, place = config.camera.source.partition(":")
    if (other := running.other_file(config)) is not None:
        yield other
    tap, daemon = running.connected(config, any_camera=not is_given), None
    yield machine.packages()
    if tap is not None and not is_given:
        kind = ""
    if kind == "picamera2":
        yield machine.picamera2()
        yield machine.permissions(("/dev/media*", "/dev/dma_heap/*"))
    elif kind == "v4l2":
        yield machine.permissions((place,))
    if tap is None:
        yield from _to_its_end("camera", _camera(config))
    else:
        daemon = tap.hello.get("pid")
        with tap:
            yield from _to_its_end("daemon", running.examine(tap, config if is_given else None))
    yield _panel_ids(config)
    yield _map(config)
    yield from _to_its_end("serial port", _serial(config.serial, daemon))
    if config.serial.protocol == "mavlink":
        yield _mavlink()
    yield from _to_its_end("outputs", examine_outputs(config))
    yield machine.disk()
    yield from machine.kept(config.file or machine.CALIBRATION_FOLDER)
    yield machine.clock()
    yield machine.throttling()
    if tap is None:  # a daemon that runs says itself whether it keeps up
        yield camera.speed(config)


def _to_its_end(name: str, findings: Iterator[Finding]) -> Iterator[Finding]:
    """Yields all of them; what nobody has foreseen is a finding, too: the page goes on."""
    try:
        yield from findings
    except Exception as error:
        said = f"could not be looked at: {type(error).__name__}: {one_line(str(error))}"
        yield bad(name, said, "`ledpi run` says more", stops_daemon=True)


def _camera(config: Config) -> Iterator[Finding]:
    found, info = camera.camera(config)
    yield from found
    if info is not None:
        yield camera.frequencies(config, info)
    yield camera.intrinsics(config, info)


def _panel_ids(config: Config) -> Finding:
    """Which are reported; those that have an override, or are on a body, should be."""
    panels = config.panels
    named = {"panels.overrides": panels.overrides} | {f"bodies.{name}": on for name, on in config.bodies.items()}
    for key, ids in named.items():
        if note := panels.unreported_note(ids):
            return bad("panel IDs", f"{key}: {note}", "list all your panels in panels.ids")
    if panels.ids is not None:
        listed = f"panels.ids: {format_ranges(sorted(panels.ids))}"
        return ok("panel IDs", "; ".join(filter(None, (listed, panels.reflection_note()))))
    words = len(panels.words.codewords)
    return ok("panel IDs", panels.unreported_note(range(words)) or f"all of {panels.dictionary}")


def _map(config: Config) -> Finding:
    """Read as the daemon does, which does not start with a broken one."""
    try:
        panels = load_own_map(config)
    except LedpiError as error:
        return bad("map", str(error), "correct it, or make one with `ledpi calibrate map`", stops_daemon=True)
    if panels is None:
        return unknown("map", "map is not set: panel positions are sent, no robot position")
    strangers = unreadable_note(config.panels, panels, config.map)
    if strangers:
        return bad("map", strangers, "correct their IDs, panels.dictionary or panels.ids")
    return ok("map", f"{config.map}: {counted(len(panels), 'panel')}")


def _serial(settings: SerialSettings, daemon: int | None) -> Iterator[Finding]:
    """`daemon`: the process that has the port, if one runs."""
    port = settings.port
    if daemon is None:
        yield unknown("serial port", running.NO_PORT) if port is None else _serial_port(port, settings.baud)
    if port is None:
        return
    notes = (ports.shared(port, but=daemon), ports.name(port), ports.pins(port), ports.allowed(port), ports.rule())
    yield from (note for note in notes if note is not None)
    yield ports.console(port)


def _serial_port(port: str, baud: int) -> Finding:
    """Opened as the daemon does; without it the daemon runs, and tries again and again."""
    from ledpi.wire.line import open_port

    try:
        open_port(port, baud).close()
    except WireError as error:
        what, in_use, holder = str(error).partition(", held by ")
        if in_use:
            return bad("serial port", what, f"it is held by {holder}")
        if "in use" in what:
            return bad(
                "serial port", what, "`sudo ledpi doctor` names it; `sudo systemctl stop ledpi`, if it is the daemon"
            )
        return bad("serial port", what, ports.remedy())
    return ok("serial port", f"{port}, {baud} baud")


def _mavlink() -> Finding:
    from ledpi.wire.mavlink import load_dialect

    try:
        load_dialect()
    except LedpiError as error:
        return bad("mavlink", str(error), "install it, or set serial.protocol: ledpi", stops_daemon=True)
    return ok("mavlink", "pymavlink is installed")


GROUP = "ledpi"  # of the bridges' unit
SOON_S = 14 * 86400.0  # before its end a certificate is told of
SYSTEMCTL_S = 10.0


def examine_outputs(config: Config) -> Iterator[Finding]:
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
