"""The daemon's work so far, as one record, and all that is told of it: to the controller, the journal and the tap."""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from ledpi.core.records import Decoded, Rejected
from ledpi.daemon.liveness import Liveness
from ledpi.daemon.reporting import event
from ledpi.daemon.ring import RingCounters
from ledpi.pose.fix import NOT_IN_MAP
from ledpi.wire.message import NoFix, State, StatusMessage
from ledpi.wire.publisher_counters import PublisherCounters

SYS = Path("/sys")
_TEMPERATURE = "class/thermal/thermal_zone0/temp"  # m°C
# The Raspberry Pi kernel's own; what `vcgencmd get_throttled` prints, in hexadecimal. Absent on other machines.
# The folders are named by the SoC's bus: `soc` up to the Pi 4, `soc@107c000000` of a Pi 5.
_THROTTLED = "devices/platform/soc*/soc*:firmware/get_throttled"
# Of the firmware's hwmon device, which is there also where a Pi 5's kernel has no file for the rest. It says
# under-voltage, now; without that nothing is known.
_LOW_VOLTAGE = "devices/platform/soc*/soc*:firmware/raspberrypi-hwmon*/hwmon/hwmon*/in0_lcrit_alarm"
UNDER_VOLTAGE = 1
Times: TypeAlias = dict[str, tuple[float, float]]  # median and 99th percentile: find to pose, and of each stage
RECENT = 512  # frames that the times are taken from: some 8 s of a 60 fps camera
RECENT_S = 5  # of packets: long enough for several of each kind, and short enough to be now
STARTING_S = 2.0  # so long the first frame may take


@dataclass(frozen=True, slots=True, kw_only=True)
class Processor:
    """None where this machine does not tell."""

    temperature_c: int | None
    throttling: int | None  # as the status message's: bits 0 to 3 now, 8 to 11 the same since boot


def read_processor(sys: Path = SYS) -> Processor:
    """Returns what the files say now; a file that is absent or says nonsense is None."""
    temperature = _number(sys / _TEMPERATURE, 10)
    throttled = next((_number(file, 16) for file in sys.glob(_THROTTLED)), None)
    if throttled is None and any(_number(file, 10) == 1 for file in sys.glob(_LOW_VOLTAGE)):
        throttled = UNDER_VOLTAGE
    return Processor(
        temperature_c=None if temperature is None else round(temperature / 1000),
        throttling=None if throttled is None else throttled & 0xF | (throttled >> 16 & 0xF) << 8,
    )


def _number(path: Path, base: int) -> int | None:
    try:
        return int(path.read_text(encoding="ascii"), base)
    except (OSError, ValueError):
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Totals:
    """One record of a daemon's work: sums since the start, what the newest frame showed, and recent times."""

    frames: int  # that the camera gave
    dropped: int  # of them: overtaken by a newer one
    decoded: int
    markers: int
    in_view: int  # panels in the newest decoded frame
    fixed: bool  # whether that gave the robot's place in the map
    no_fix: str | None  # and why it did not, where that was tried
    rejected: dict[str, int]
    times_ms: Times
    packets: PublisherCounters
    processor: Processor


class Health:
    """Written by the capture and decode threads, read by any; `refresh` is for one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._rejected: Counter[str] = Counter()
        self._recent: deque[dict[str, float]] = deque(maxlen=RECENT)
        self._decoded = self._markers = self._in_view = 0
        self._fixed = False
        self._no_fix: str | None = None
        self._times_ms: Times = {}
        self._processor = read_processor()

    def reject(self, rejected: Rejected) -> None:
        """Counts something that was dropped outside the decoder."""
        with self._lock:
            self._rejected[rejected.key] += 1

    def add(self, decoded: Decoded) -> None:
        """Counts a decoded frame."""
        with self._lock:
            self._decoded += 1
            self._markers += len(decoded.markers)
            self._in_view = len(decoded.markers)
            self._fixed = decoded.robot is not None
            self._no_fix = next((r.reason for r in decoded.rejected if r.stage == "fix"), None)
            self._rejected.update(rejected.key for rejected in decoded.rejected)
            self._recent.append(decoded.stage_ms)

    def refresh(self) -> None:
        """Takes a millisecond, for times and processor: for once a second, not for each tick."""
        with self._lock:
            recent = list(self._recent)
        if recent:
            stages = {name: _percentiles([stages[name] for stages in recent]) for name in recent[-1]}
            self._times_ms = {"decode": _percentiles([sum(stages.values()) for stages in recent]), **stages}
        self._processor = read_processor()

    def totals(self, ring: RingCounters, packets: PublisherCounters) -> Totals:
        """A consistent picture of now."""
        with self._lock:
            return Totals(
                frames=ring.published,
                dropped=ring.dropped,
                decoded=self._decoded,
                markers=self._markers,
                in_view=self._in_view,
                fixed=self._fixed,
                no_fix=self._no_fix,
                rejected=dict(sorted(self._rejected.items())),
                times_ms=self._times_ms,
                packets=packets,
                processor=self._processor,
            )


def _percentiles(values: list[float]) -> tuple[float, float]:
    values.sort()
    return values[len(values) // 2], values[int(0.99 * len(values))]


# ---- To the controller


def status(now: Totals, liveness: Liveness, *, uptime_s: float, calibrated: bool, has_map: bool) -> StatusMessage:
    """The message of this moment."""
    lost, behind = liveness.lost, liveness.behind
    state, no_fix = State.RUNNING, _no_fix(now, calibrated=calibrated, has_map=has_map)
    if not now.decoded and uptime_s < STARTING_S:
        state, no_fix = State.STARTING, NoFix.NOT_RUNNING
    elif lost:
        state, no_fix = State.CAMERA_LOST, NoFix.NO_FRAMES
    elif behind:
        no_fix = NoFix.BEHIND
    p50_us, p99_us = (round(1e3 * ms) for ms in now.times_ms["decode"]) if now.times_ms else (None, None)
    return StatusMessage(
        state=state,
        no_fix=no_fix,
        panels_in_view=0 if lost else None if behind else now.in_view,
        uptime_s=int(uptime_s),
        frames=now.frames,
        frames_dropped=now.dropped,
        markers=now.markers,
        packets_dropped=now.packets.unsent,
        temperature_c=now.processor.temperature_c,
        throttling=now.processor.throttling,
        decode_p50_us=p50_us,
        decode_p99_us=p99_us,
    )


def _no_fix(now: Totals, *, calibrated: bool, has_map: bool) -> NoFix:
    """While frames come and are decoded in time."""
    if not calibrated:
        return NoFix.UNCALIBRATED
    if not has_map:
        return NoFix.NO_MAP
    if now.fixed:
        return NoFix.NONE
    if not now.in_view:
        return NoFix.NO_PANEL
    return NoFix.NOT_IN_MAP if now.no_fix == NOT_IN_MAP.reason else NoFix.REJECTED


# ---- To the journal


def second_line(before: Totals, now: Totals, seconds: float) -> str:
    """For a person who watches: what the last second brought, and what was lost so far."""
    packets = now.packets
    stages = " ".join(f"{name} {p50:.1f}" for name, (p50, _) in now.times_ms.items() if name != "decode")
    port = "port open" if packets.connected else f"no port ({packets.error})" if packets.error else "no port"
    return (
        f"{(now.frames - before.frames) / seconds:.0f} frames/s, "
        f"{(now.decoded - before.decoded) / seconds:.0f} decoded/s, "
        f"{(now.markers - before.markers) / seconds:.0f} markers/s, {now.in_view} in view; "
        f"dropped {now.dropped} of {now.frames}; ms: {stages or 'none'}; "
        f"packets {(packets.sent - before.packets.sent) / seconds:.0f}/s, stale {packets.stale}, {port}"
    )


def minute_line(now: Totals) -> str:
    """Every counter since the start by stage and reason, and the times of the recent frames."""
    counts: dict[str, object] = {
        name: getattr(now, name) for name in ("frames", "dropped", "decoded", "markers", "in_view")
    }
    for name, (p50, p99) in now.times_ms.items():
        counts |= {f"{name}_p50_ms": f"{p50:.2f}", f"{name}_p99_ms": f"{p99:.2f}"}
    counts |= {f"sent.{kind}": getattr(now.packets, kind) for kind in ("fixes", "statuses", "markers")}
    counts |= {f"unsent.{kind}": getattr(now.packets, kind) for kind in ("replaced", "stale", "refused", "cut")}
    counts |= {"port_opened": now.packets.opened, "port": "open" if now.packets.connected else "absent"}
    bits = now.processor.throttling
    counts |= {"temperature_c": now.processor.temperature_c, "throttling": None if bits is None else f"0x{bits:04x}"}
    return event("health", **counts, **{f"rejected.{reason}": count for reason, count in now.rejected.items()})


# ---- To the tap


class RecentPackets:
    """The fate of the packets of the last seconds: counters since the start hide what is wrong now."""

    def __init__(self, now: PublisherCounters) -> None:
        self._counters = deque([now], maxlen=RECENT_S + 1)

    def add(self, now: PublisherCounters) -> dict[str, int]:
        """Takes in the counters of this second; returns those of the last RECENT_S, or of as many as there are."""
        self._counters.append(now)
        first = self._counters[0]
        names = ("sent", "replaced", "stale", "refused")
        counts = {name: getattr(now, name) - getattr(first, name) for name in names}
        return {"seconds": len(self._counters) - 1, **counts}


def health(
    before: Totals, now: Totals, seconds: float, status: StatusMessage, recent: Mapping[str, int]
) -> dict[str, Any]:
    """The line of each second, but for what the tap itself knows. `recent`: as `RecentPackets` gives it."""
    packets = now.packets
    return {
        "state": status.state.name.lower(),
        "no_fix": status.no_fix.name.lower(),
        "uptime_s": status.uptime_s,
        "frames_per_s": round((now.frames - before.frames) / seconds, 2),
        "decoded_per_s": round((now.decoded - before.decoded) / seconds, 2),
        "frames": now.frames,
        "decoded": now.decoded,
        "dropped_frames": now.dropped,
        "in_view": now.in_view,
        "rejected": now.rejected,
        "temperature_c": now.processor.temperature_c,
        "throttled": now.processor.throttling,
        "wire": {
            "packets": packets.sent,
            "dropped": packets.unsent,
            "port": packets.port,
            "connected": packets.connected,
            "error": packets.error,
            "recent": dict(recent),
        },
    }
