"""The C receiver of firmware/receiver, compiled for this machine: a stream → Python's own records."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from ledpi.wire import (
    FixMessage,
    MarkerMessage,
    Message,
    Mode,
    NoFix,
    ReceiverCounters,
    State,
    StateMessage,
    StatusMessage,
    TimeAsk,
    WirePose,
)
from tests.builders import ROOT

HEADER = ROOT / "firmware" / "receiver" / "ledpi_receiver.h"
SOURCE = Path(__file__).with_name("receiver_host.c")
STRICT = ["-std=c99", "-pedantic", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-I", str(HEADER.parent)]

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="not installed: gcc")

_FAULTS = ("length", "cobs", "crc", "value", "version", "type", "flags")  # as the header's ledpi_fault
_UNKNOWN = {"temperature_c": -128, "throttling": 0xFFFF, "panels_in_view": 0xFF}
_UNKNOWN |= dict.fromkeys(("uptime_s", "frames", "frames_dropped", "markers", "packets_dropped"), 0xFFFFFFFF)
_UNKNOWN |= dict.fromkeys(("decode_p50_us", "decode_p99_us"), 0xFFFF)


@dataclass(frozen=True, slots=True, kw_only=True)
class Received:
    """A receiver's result of a stream."""

    messages: list[Message]
    counters: ReceiverCounters


def host_receiver() -> Path:
    """The compiled receiver_host.c, with the checks of gcc's sanitizers; compiled again when it has changed."""
    binary = ROOT / "build" / "receiver_host"
    newest = max(HEADER.stat().st_mtime, SOURCE.stat().st_mtime)
    if not binary.exists() or binary.stat().st_mtime < newest:
        binary.parent.mkdir(exist_ok=True)
        fresh = binary.with_name(f"{binary.name}.{os.getpid()}")  # others may be compiling it, too
        sanitize = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
        subprocess.run(["gcc", *STRICT, *sanitize, "-o", str(fresh), str(SOURCE)], check=True)
        fresh.replace(binary)
    return binary


def received_in_c(stream: bytes) -> Received:
    """Returns what the C receiver makes of a stream."""
    done = subprocess.run([host_receiver()], input=stream, capture_output=True, check=True, timeout=600)
    *lines, last = (json.loads(line) for line in done.stdout.splitlines())
    faults = {name: count for name, count in zip(_FAULTS, last["faults"], strict=True) if count}
    counters = ReceiverCounters(
        good=last["good"],
        lost=last["lost"],
        restarts=last["restarts"],
        bad={name: count for name, count in faults.items() if name in _FAULTS[:4]},  # type: ignore[misc]
        skipped={name: count for name, count in faults.items() if name in _FAULTS[4:]},  # type: ignore[misc]
    )
    return Received(messages=[_message(line) for line in lines], counters=counters)


def _message(raw: dict[str, Any]) -> Message:
    if raw["message"] == "marker":
        uncalibrated, ambiguous, alternate = map(bool, raw["flags"])
        return MarkerMessage(
            id=raw["id"],
            age_us=raw["age_us"],
            pose=_pose(raw) if raw["has_pose"] else None,
            uncalibrated=uncalibrated,
            ambiguous=ambiguous,
            alternate=alternate,
        )
    if raw["message"] == "fix":
        return FixMessage(
            age_us=raw["age_us"], pose=_pose(raw), panels_used=raw["panels_used"], map_resets=raw["map_resets"]
        )
    if raw["message"] == "state":
        return _state(raw)
    if raw["message"] == "time_ask":
        return TimeAsk(number=raw["number"])
    known = {key: None if raw[key] == unknown else raw[key] for key, unknown in _UNKNOWN.items()}
    return StatusMessage(state=State(raw["state"]), no_fix=NoFix(raw["no_fix"]), **known)


def _state(raw: dict[str, Any]) -> StateMessage:
    x, y, yaw, speed, rate = raw["pose"]
    has_clock, contested, panel_moved = map(bool, raw["flags"])
    pose: dict[str, Any] = {
        "position_m": (x / 1e4, y / 1e4),
        "yaw_rad": yaw / 1e4,
        "velocity": (speed / 1e3, rate / 1e3),
        "deviations": _deviations(raw["deviations"]),
        "correlations": tuple(round(c / 127, 4) for c in raw["correlations"]),
    }
    map_resets, relocalisations, panels = raw["counts"]
    return StateMessage(
        **(pose if raw["mode"] else {}),
        clock_us=raw["clock_us"] if has_clock else None,
        panel_age_ms=None if raw["age"] == 0xFFFF else raw["age"],
        way_m=None if raw["way"] == 0xFFFF else raw["way"] / 100,
        mode=Mode(raw["mode"]),
        contested=contested,
        panel_moved=panel_moved,
        map_resets=map_resets,
        relocalisations=relocalisations,
        panels=panels,
    )


def _pose(raw: dict[str, Any]) -> WirePose:
    norm = math.hypot(*raw["quaternion_q15"])
    return WirePose(
        position_m=tuple(v / 1e4 for v in raw["position_100um"]),
        quaternion_wxyz=tuple(q / norm for q in raw["quaternion_q15"]),
        deviation_m=_deviations(raw["deviation_100um"]),
        deviation_rad=_deviations(raw["deviation_100urad"]),
    )


def _deviations(steps: list[int]) -> tuple[float, float, float] | None:
    a, b, c = (step / 1e4 for step in steps)
    return None if steps[0] == 0xFFFFFFFF else (a, b, c)
