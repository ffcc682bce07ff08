"""All checks, in the order of the page."""

from __future__ import annotations

from collections.abc import Iterator

from ledpi.config import Config
from ledpi.doctor import camera, machine
from ledpi.doctor.finding import Finding, bad, ok
from ledpi.errors import WireError


def examine(config: Config) -> Iterator[Finding]:
    """Each finding as soon as it is known; the camera takes a second or two."""
    kind, _, place = config.camera.source.partition(":")
    yield machine.packages()
    if kind == "picamera2":
        yield machine.picamera2()
        yield machine.permissions(("/dev/media*", "/dev/dma_heap/*"))
    elif kind == "v4l2":
        yield machine.permissions((place,))
    found, info = camera.camera(config)
    yield from found
    if info is not None:
        yield camera.frequencies(config, info)
    yield camera.intrinsics(config, info)
    yield _serial_port(config)
    yield machine.serial_console(config.serial.port)
    yield machine.disk()
    yield machine.clock()
    yield machine.throttling()


def _serial_port(config: Config) -> Finding:
    """Opened as the daemon does; without it the daemon runs, and tries again and again."""
    from ledpi.wire.line import open_port

    settings = config.serial
    try:
        open_port(settings.port, settings.baud).close()
    except WireError as error:
        remedy = "set serial.port; `ls -l /dev/serial/by-id` shows what is plugged in"
        if "in use" in str(error):
            remedy = "another process has it: `sudo systemctl stop ledpi`, if that is the daemon"
        return bad("serial port", str(error), remedy)
    return ok("serial port", f"{settings.port}, {settings.baud} baud")
