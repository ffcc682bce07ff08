"""The daemon that runs here, which has the camera: what is wrong with it now, and what to do, as its tap tells."""

from __future__ import annotations

import json
import shlex
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ledpi.camera.factory import vanishing
from ledpi.config.origins import values_of
from ledpi.config.settings import Config
from ledpi.core.errors import TapError
from ledpi.core.wording import shortened_name
from ledpi.daemon.tap.client import Client, connect
from ledpi.daemon.tap.frames import WITH_REASONS, frame_of, not_read_of, read_px_of, settings_of, why_not_of
from ledpi.daemon.tap.places import of_config
from ledpi.workshop.doctor import ports
from ledpi.workshop.doctor.camera import findings_of
from ledpi.workshop.doctor.finding import Finding, bad, ok, unknown

HEALTH_S = 3.0  # within which a daemon says how it is, which it does each second
PICTURES = 6  # that are looked at: a stream searches the whole picture in every third frame
MOST_NAMED = 3  # values that are told of
# Of the poses of the last seconds, that may be dropped: a controller that gets fewer steers by older ones. A frame that
# comes while the one before is on the line loses single poses, and that is as it should be.
MOST_DROPPED = 0.1
HOT_C = 80.0  # from which a Pi becomes slower
NO_PORT = "serial.port is null: poses go to the tap alone"
UNDER_VOLTAGE, THROTTLED = 1 << 0, 1 << 2  # bits of the Pi's `vcgencmd get_throttled`


def connected(config: Config, *, any_camera: bool = False) -> Client | None:
    """To the daemon that has the camera of this configuration; None where none runs, or another camera is asked for."""
    socket_path = of_config(config)
    if socket_path is None:
        return None
    try:
        tap = connect(socket_path)
    except TapError:
        return None
    if any_camera or tap.hello.get("camera", {}).get("source") == config.camera.source:
        return tap
    tap.close()
    return None


def other_file(config: Config) -> Finding | None:
    """Says so where the daemon here runs with another configuration file than the one that is looked at."""
    socket_path = of_config(config)
    if socket_path is None or config.file is None:
        return None
    try:
        with connect(socket_path) as tap:
            path = tap.hello.get("config_path")
    except TapError:
        return None
    if path is None or Path(path).resolve() == config.file.resolve():
        return None
    said = f"the daemon that runs here has {shortened_name(path)}, not {config.file}"
    return bad("configuration", said, f"to see that one: ledpi doctor --config {shlex.quote(path)}")


def examine(tap: Client, config: Config | None) -> Iterator[Finding]:
    """The daemon, whether it runs with this configuration, if there is one, and the panels before its camera."""
    yield ok("daemon", f"runs (pid {tap.hello.get('pid')}) and has the camera, so it was asked")
    try:
        if config is not None:
            yield from other_settings(tap.ask("config")["values"], config)
        health = _health(tap)
        if health is not None:
            yield from (finding for finding in checks(tap.hello, health) if finding.name != "map")
        yield from _in_view(tap)
    except TapError as error:
        yield unknown("panels", f"could not be looked for: {error}")


def other_settings(of_daemon: dict[str, Any], config: Config) -> list[Finding]:
    """Which values the daemon runs with that this configuration has otherwise, as after a change without a reload."""
    here = values_of(config)
    other = [key for key in here if key in of_daemon and of_daemon[key] != here[key] and not key.startswith("view.")]
    if not other:
        return []
    said = ", ".join(f"{key} {_value(of_daemon[key])}, not {_value(here[key])}" for key in other[:MOST_NAMED])
    more = f" (and {len(other) - MOST_NAMED} more)" if len(other) > MOST_NAMED else ""
    remedy = "to use this configuration: `sudo systemctl reload ledpi`, or restart the daemon with it"
    return [bad("settings", f"the daemon runs with {said}{more}", remedy)]


def _value(value: Any) -> str:
    """As config.yaml has it."""
    return shortened_name(json.dumps(value, ensure_ascii=False))


def _health(tap: Client) -> dict[str, Any] | None:
    until_s = time.monotonic() + HEALTH_S
    for line in tap.lines(tick_s=HEALTH_S):
        if line["type"] == "health":
            return line
        if time.monotonic() > until_s:
            break
    return None


def _in_view(tap: Client) -> list[Finding]:
    """The picture of several in which most is told. A panel that is read in one of them is read."""
    pictures = [tap.picture(*WITH_REASONS) for _ in range(PICTURES)]
    picture = max(pictures, key=lambda one: len(not_read_of(one)))
    read = sorted({marker["id"] for one in pictures for marker in one["decoded"]["markers"]})
    read_px = [corners for one in pictures for corners in read_px_of(one)]
    run = [frame_of(tap.hello, one) for one in pictures]
    why = why_not_of(tap.hello).explain(frame_of(tap.hello, picture), not_read_of(picture), read_px, run)
    return findings_of(read, why)


def checks(hello: dict[str, Any], health: dict[str, Any]) -> list[Finding]:
    """Camera, lens, exposure, map, serial port and processor, as the daemon tells them."""
    found = (_camera(health), _lens(hello), _exposure(hello), _map(hello), _line(health), _processor(health))
    return [finding for finding in found if finding is not None]


def _camera(health: dict[str, Any]) -> Finding:
    state = health["state"].replace("_", " ")
    if health["state"] == "camera_lost":
        return bad("camera", "is lost; the daemon is retrying", "check its cable and supply")
    if health.get("no_fix") == "behind":
        return bad("frames", "decoding is too slow", "end other programs, or set a longer frame period")
    return ok("camera", f"{state}, {health.get('frames_per_s') or 0:.0f} frames/s")


def _lens(hello: dict[str, Any]) -> Finding:
    if hello["camera"].get("fx") is None:
        return bad("lens", "is not calibrated: IDs are read, and no poses", "ledpi calibrate camera")
    return ok("lens", f"{hello['camera']['fx']:.0f} pixels focal length")


def _exposure(hello: dict[str, Any]) -> Finding | None:
    exposure_us = hello["camera"].get("exposure_us")
    if not exposure_us:
        return None
    try:
        panels = settings_of(hello).panels
        weak = " and ".join(f"{hz:g} Hz" for hz in vanishing(panels, exposure_us))
    except (TapError, ValueError) as error:
        return bad("panels", str(error), "correct the configuration's panels")
    if weak:
        return bad(
            "exposure",
            f"{exposure_us:.0f} µs are at a null of {weak}: such bands all but vanish",
            "exposure × frequency must be near a whole number and a half: ledpi panel design",
        )
    return ok("exposure", f"{exposure_us:.0f} µs: bands at {panels.spec().blinking()} are visible")


def _map(hello: dict[str, Any]) -> Finding:
    panels = hello.get("map")
    if not panels:
        return unknown("map", "no map: panel positions only, no robot position")
    return ok("map", f"{len(panels)} panel{'s' * (len(panels) > 1)}")


def _line(health: dict[str, Any]) -> Finding | None:
    wire = health.get("wire")
    if not isinstance(wire, dict):
        return None
    if wire.get("port", "") is None:
        return unknown("serial port", NO_PORT)
    if not wire.get("connected"):
        said = str(wire.get("error") or "the port cannot be opened")
        return bad("serial port", said, ports.remedy())
    recent = wire.get("recent")
    if not isinstance(recent, dict) or not recent.get("seconds"):
        return ok("serial port", f"{wire.get('packets', 0)} packets sent, {wire.get('dropped', 0)} dropped")
    return _recent_line(**{name: int(recent.get(name, 0)) for name in _RECENT})


_RECENT = ("seconds", "sent", "replaced", "stale", "refused")


def _recent_line(*, seconds: int, sent: int, replaced: int, stale: int, refused: int) -> Finding:
    """Says what became of the packets of the last seconds. A status packet is due each second at least."""
    last = f"of the last {seconds} s"
    due, dropped = sent + replaced + stale + refused, replaced + stale + refused
    if sent == 0 and (seconds > 1 or dropped):
        said = f"is open, but takes nothing: none of {due} packets {last} left"
        return bad("serial port", said, "see that the controller runs and reads; unplug it and plug it in again")
    if dropped <= MOST_DROPPED * due:
        return ok("serial port", f"{sent / seconds:.0f} packets a second; {dropped} of {due} {last} were dropped")
    if stale >= max(replaced, refused):
        said = f"{stale} of {due} packets {last} were older than serial.max_age_ms, and not sent"
        return bad("serial port", said, "end other programs; a smaller picture; or a larger serial.max_age_ms")
    if replaced >= refused:
        said = f"{replaced} of {due} packets {last} found the line busy, and a newer one was sent instead"
        return bad("serial port", said, "a higher serial.baud, here and in the controller")
    said = f"{refused} of {due} packets {last} were out of the packet's range, or from the future"
    return bad("serial port", said, "check the lens, the map, and the camera's clock: `ledpi snapshot`")


def _processor(health: dict[str, Any]) -> Finding | None:
    temperature_c, throttled = health.get("temperature_c"), health.get("throttled")
    bits = throttled if isinstance(throttled, int) else 0
    if bits & UNDER_VOLTAGE:
        return bad("processor", "its voltage is too low", "use a stronger supply or a shorter cable")
    if bits & THROTTLED or (temperature_c or 0) >= HOT_C:
        return bad("processor", f"is too hot and slowed down ({temperature_c} °C)", "cool it")
    return None if temperature_c is None else ok("processor", f"{temperature_c:.0f} °C")
