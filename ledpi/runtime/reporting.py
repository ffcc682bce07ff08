"""Reports of a run to the journal: single lines, `key=value` where a program may read them."""

from __future__ import annotations

import json
import logging
import os
import select
import sys
from dataclasses import dataclass
from typing import TextIO

from ledpi.runtime.health import HealthSnapshot, StageTimes
from ledpi.runtime.processor import Processor
from ledpi.runtime.ring import RingCounters
from ledpi.wire.publisher_counters import PublisherCounters

_PRIORITIES = {logging.ERROR: 3, logging.WARNING: 4, logging.INFO: 6, logging.DEBUG: 7}  # syslog's


@dataclass(frozen=True, slots=True, kw_only=True)
class Totals:
    """The sums of a run."""

    health: HealthSnapshot
    times: StageTimes
    ring: RingCounters
    packets: PublisherCounters


def is_service() -> bool:
    """Tells whether a service manager has started us, and its journal takes our lines."""
    return "NOTIFY_SOCKET" in os.environ


class _JournalFormatter(logging.Formatter):
    """sd-daemon(3): `<4>` at a line's start gives it its priority in the journal."""

    def format(self, record: logging.LogRecord) -> str:
        text = " ".join(super().format(record).split("\n"))
        return f"<{_PRIORITIES.get(record.levelno, 5)}>{text}"


class _NeverWaiting(logging.StreamHandler):  # type: ignore[type-arg]  # Python 3.10 has none at run time
    """Drops what nobody takes, as of a pager that waits or a terminal that was stopped with Ctrl-S.

    Else each thread that has something to say would wait, the heartbeat's and the watchdog's too, and SIGTERM end none.
    """

    def emit(self, record: logging.LogRecord) -> None:
        """A line is less than what a pipe or a socket has room for once it is ready."""
        if _is_ready(self.stream):
            super().emit(record)


def _is_ready(stream: TextIO) -> bool:
    """Tells whether it takes a line at once; a file always does."""
    try:
        poll = select.poll()
        poll.register(stream.fileno(), select.POLLOUT)
        return bool(poll.poll(0))
    except (OSError, ValueError, AttributeError):  # it is none of the system's, or none at all
        return True


def log_to_standard_error() -> None:
    """With the level as a word; in a service, as the journal's priority. Never waits for who reads it."""
    handler = _NeverWaiting(sys.stderr)
    handler.setFormatter(_JournalFormatter() if is_service() else logging.Formatter("%(levelname)s %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])


def event(name: str, **values: object) -> str:
    """A line such as `serial_lost port=/dev/ttyACM0 error="no such device"`; what is None is left out."""
    return " ".join([name, *(f"{key}={_quoted(value)}" for key, value in values.items() if value is not None)])


def _quoted(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return text if text and not set(text) & set(' "=\n') else json.dumps(text, ensure_ascii=False)


def second_line(before: Totals, now: Totals, seconds: float) -> str:
    """For a person who watches: what the last second brought, and what was lost so far."""
    health, packets = now.health, now.packets
    stages = " ".join(f"{name} {p50:.1f}" for name, (p50, _) in now.times.stages_ms.items())
    port = "port open" if packets.connected else f"no port ({packets.error})" if packets.error else "no port"
    return (
        f"{(now.ring.published - before.ring.published) / seconds:.0f} frames/s, "
        f"{(health.decoded - before.health.decoded) / seconds:.0f} decoded/s, "
        f"{(health.markers - before.health.markers) / seconds:.0f} markers/s, {health.in_view} in view; "
        f"dropped {now.ring.dropped} of {now.ring.published}; ms: {stages or 'none'}; "
        f"packets {(packets.sent - before.packets.sent) / seconds:.0f}/s, stale {packets.stale}, {port}"
    )


def minute_line(now: Totals, processor: Processor) -> str:
    """For the journal: every counter since the start by stage and reason, and the times of the recent frames."""
    health, packets = now.health, now.packets
    counts: dict[str, object] = {
        "frames": now.ring.published,
        "dropped": now.ring.dropped,
        "decoded": health.decoded,
        "markers": health.markers,
        "in_view": health.in_view,
    }
    decode_ms = () if now.times.decode_ms is None else (("decode", now.times.decode_ms),)
    for name, (p50, p99) in (*decode_ms, *now.times.stages_ms.items()):
        counts |= {f"{name}_p50_ms": f"{p50:.2f}", f"{name}_p99_ms": f"{p99:.2f}"}
    counts |= {f"sent.{kind}": getattr(packets, kind) for kind in ("fixes", "statuses", "markers")}
    counts |= {f"unsent.{kind}": getattr(packets, kind) for kind in ("replaced", "stale", "refused", "cut")}
    counts |= {"port_opened": packets.opened, "port": "open" if packets.connected else "absent"}
    counts |= {"temperature_c": processor.temperature_c}
    counts |= {"throttling": None if processor.throttling is None else f"0x{processor.throttling:04x}"}
    counts |= {f"rejected.{reason}": count for reason, count in sorted(health.rejected.items())}
    return event("health", **counts)
