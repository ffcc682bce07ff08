"""The state of calibration: what there is, how old and how good that is, and what comes next."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date, datetime
from pathlib import Path
from typing import Any

from ledpi.config.camera_yaml import load_intrinsics, own_section
from ledpi.config.map_yaml import load_map
from ledpi.config.own_map import unreadable_note
from ledpi.config.settings import Config
from ledpi.core.errors import CalibrationError, ConfigError
from ledpi.core.wording import counted

OLD_DAYS = 365  # a lens that was never touched does not change; one that was knocked does


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One thing that can be calibrated."""

    name: str
    text: str
    done: bool
    command: str  # that calibrates it


def parts(config: Config, today: date) -> Iterator[Part]:
    """Lens, shutter, panels and map, in the order in which they build on each other."""
    yield _lens(config, today)
    yield _shutter(config, today)
    yield _panels(config, today)
    yield _map(config, today)


def next_command(found: list[Part]) -> str | None:
    """Returns what to run next; None where nothing is missing."""
    return next((part.command for part in found if not part.done), None)


def _lens(config: Config, today: date) -> Part:
    path = config.camera.intrinsics
    command = "ledpi calibrate camera (a board to print: ledpi calibrate board)"
    if path is None:
        return Part(name="camera", text="no camera.intrinsics: IDs, but no poses", done=False, command=command)
    try:
        lens = load_intrinsics(path, (config.camera.width, config.camera.height))
    except CalibrationError as error:
        return Part(name="camera", text=str(error), done=False, command=command)
    own = own_section(path)
    quality = [f"{lens.width} × {lens.height}"]
    if _is_number(own.get("rms_px")):
        quality.append(f"rms {own['rms_px']:.3f} px of {own.get('views', '?')} views")
    if isinstance(deviations := own.get("deviations"), dict) and _is_number(deviations.get("fx")):
        quality.append(f"fx {lens.fx:.1f} ± {deviations['fx']:g} px")
    day = own.get("calibrated") or _changed(path)
    text = f"{path}: {', '.join(quality)}, {_age(day, today)}"
    return Part(name="camera", text=text, done=not _is_old(day, today), command=command)


def _shutter(config: Config, today: date) -> Part:
    path = config.camera.intrinsics
    measured = own_section(path).get("shutter") if path is not None else None
    used = config.camera.row_time_us
    text = "row time: what the driver says" if used == "auto" else f"row time: {used:g} µs, set in the configuration"
    noted = isinstance(measured, dict) and _is_number(measured.get("row_time_us"))
    if noted and measured is not None:
        sigma = measured.get("row_time_sigma_us", "?")
        text += f"; measured {measured['row_time_us']:g} ± {sigma} µs, {_age(measured.get('measured'), today)}"
    elif used == "auto":
        text += ", never measured"
    done = used != "auto" or noted
    return Part(name="shutter", text=text, done=done, command="ledpi calibrate shutter (before a panel with a crystal)")


def _panels(config: Config, today: date) -> Part:
    panels, common = config.panels, config.panels.spec()
    measured = {i: o.measured for i, o in sorted(panels.overrides.items()) if o.measured is not None}
    texts = []
    for marker_id, day in measured.items():
        spec = panels.spec(marker_id)
        value = "as announced" if spec.waves_hz == common.waves_hz else spec.blinking()
        texts.append(f"{marker_id}: {value}, {_age(day, today)}")
    rest = "others not" if measured else "none"
    texts.append(f"{rest} measured; announced are {common.blinking()}")
    command = "ledpi calibrate panel (before each of them)"
    return Part(name="panels", text="; ".join(texts), done=bool(measured), command=command)


def _map(config: Config, today: date) -> Part:
    command = "ledpi calibrate map"
    if config.map is None:
        return Part(name="map", text="no map: poses of panels, but none of the robot", done=False, command=command)
    try:
        panels = load_map(config.map)
    except ConfigError as error:
        return Part(name="map", text=str(error), done=False, command=command)
    text = f"{config.map}: {counted(len(panels), 'panel')}, {_age(_changed(config.map), today)}"
    strangers = unreadable_note(config.panels, panels, config.map)
    return Part(name="map", text="; ".join(filter(None, (text, strangers))), done=not strangers, command=command)


def _is_number(value: Any) -> bool:
    """A person may have edited the file; what is none is passed over."""
    return isinstance(value, (int, float))


def _changed(path: Path) -> date:
    return datetime.fromtimestamp(path.stat().st_mtime).date()


def _is_old(day: Any, today: date) -> bool:
    return isinstance(day, date) and (today - day).days > OLD_DAYS


def _age(day: Any, today: date) -> str:
    if not isinstance(day, date):
        return "of unknown age"
    days = (today - day).days
    return "of today" if days <= 0 else f"{counted(days, 'day')} old"
