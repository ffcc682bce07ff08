"""What `ledpi doctor` would ask, of the daemon that runs: what is wrong with it now, and what to do. Pure."""

from __future__ import annotations

from typing import Any

from ledpi.core.records import PanelSpec
from ledpi.core.shutter import contrast
from ledpi.tools.doctor.finding import Finding, bad, ok, unknown

NEAR_NULL = 0.2  # of the depth that the best exposure of about this length would give
HOT_C = 80.0  # from which a Pi becomes slower
UNDER_VOLTAGE, THROTTLED = 1 << 0, 1 << 2  # bits of the Pi's `vcgencmd get_throttled`


def checks(hello: dict[str, Any], health: dict[str, Any]) -> list[Finding]:
    """Camera, lens, exposure, map, serial line and processor, as the daemon tells them."""
    found = (_camera(health), _lens(hello), _exposure(hello), _map(hello), _line(health), _processor(health))
    return [finding for finding in found if finding is not None]


def _camera(health: dict[str, Any]) -> Finding:
    state = health["state"].replace("_", " ")
    if health["state"] == "camera_lost":
        return bad("camera", "is lost; the daemon opens it again", "check its cable and supply")
    if health.get("no_fix") == "behind":
        return bad("frames", "come faster than they are decoded", "end other programs, or set a longer frame period")
    return ok("camera", f"{state}, {health.get('frames_per_s') or 0:.0f} frames/s")


def _lens(hello: dict[str, Any]) -> Finding:
    if hello["camera"].get("fx") is None:
        return bad("lens", "is not calibrated: IDs are read, and no poses", "ledpi calibrate camera")
    return ok("lens", f"{hello['camera']['fx']:.0f} pixels focal length")


def _exposure(hello: dict[str, Any]) -> Finding | None:
    panels, exposure_us = hello["panels"], hello["camera"].get("exposure_us")
    if not exposure_us:
        return None
    values = {key: panels[key] for key in ("side_m", "black_hz", "white_hz", "duty", "phase") if key in panels}
    try:
        spec = PanelSpec(**values)
    except (ValueError, TypeError) as error:
        return bad("panels", str(error), "correct the configuration's panels")
    weak = [
        f"{hz:g} Hz"
        for hz in spec.waves_hz
        if contrast(hz, exposure_us, spec.duty) < NEAR_NULL * min(2.0, 1e6 / (hz * exposure_us))
    ]
    if weak:
        return bad(
            "exposure",
            f"{exposure_us:.0f} µs are near a null of {' and '.join(weak)}: such bands all but vanish",
            "exposure × frequency must be near a whole number and a half: ledpi panel design",
        )
    return ok("exposure", f"{exposure_us:.0f} µs show the bands of {spec.blinking()}")


def _map(hello: dict[str, Any]) -> Finding:
    panels = hello.get("map")
    if not panels:
        return unknown("map", "none: panels have poses, the robot has no place")
    return ok("map", f"{len(panels)} panel{'s' * (len(panels) > 1)}")


def _line(health: dict[str, Any]) -> Finding | None:
    wire = health.get("wire")
    if not isinstance(wire, dict):
        return None
    if not wire.get("connected"):
        said = str(wire.get("error") or "the port cannot be opened")
        return bad("serial line", said, "plug the controller in, or set serial.port: ls /dev/serial/by-id")
    return ok("serial line", f"{wire.get('packets', 0)} packets sent, {wire.get('dropped', 0)} dropped")


def _processor(health: dict[str, Any]) -> Finding | None:
    temperature_c, throttled = health.get("temperature_c"), health.get("throttled")
    bits = throttled if isinstance(throttled, int) else 0
    if bits & UNDER_VOLTAGE:
        return bad("processor", "its voltage is too low", "use a stronger supply or a shorter cable")
    if bits & THROTTLED or (temperature_c or 0) >= HOT_C:
        return bad("processor", f"is too hot and slowed down ({temperature_c} °C)", "cool it")
    return None if temperature_c is None else ok("processor", f"{temperature_c:.0f} °C")
