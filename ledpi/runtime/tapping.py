"""Answers of the daemon to those who follow its tap, and where that is."""

from __future__ import annotations

import logging
import os
from collections import deque
from collections.abc import Mapping
from typing import Any

from ledpi.config.origins import origins_of, values_of
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import Config
from ledpi.core.errors import ConfigError
from ledpi.core.records import CameraInfo, Intrinsics
from ledpi.pose.panel_map import PanelMap
from ledpi.runtime.reporting import Totals, event
from ledpi.tap.messages import Setup
from ledpi.tap.places import AUTO, to_serve
from ledpi.tap.server import Tap
from ledpi.wire.message import StatusMessage
from ledpi.wire.publisher_counters import PublisherCounters

RECENT_S = 5  # long enough for several packets of each kind, and short enough to be now

_log = logging.getLogger("ledpi")


def open_tap(config: Config, now: Tap | None = None) -> Tap | None:
    """The tap that this configuration asks for: `now`, if that is where it is, and can still be found there.

    Raises ConfigError where a path is given at which none can be. Where `auto` finds no place the daemon runs without:
    a robot needs its poses more than anybody needs to look at them.
    """
    setting = config.tap.socket
    if setting is None:
        return None
    try:
        path = to_serve(setting)
        if now is not None and now.path == path and now.is_there:
            return now
        tap = Tap(path)
    except ConfigError as error:
        if setting != AUTO:
            raise
        _log.warning(event("tap_off", reason=str(error)))
        return None
    tap.start()
    return tap


def close_tap(tap: Tap | None, but: Tap | None = None) -> None:
    """Closes it, if there is one and it is not the one that goes on."""
    if tap is not None and tap is not but:
        tap.close()


def setup_of(
    config: Config, camera: CameraInfo, panels: PanelSettings, lens: Intrinsics | None, panel_map: PanelMap | None
) -> Setup:
    """Returns what a follower is told first. `panels`: with what the camera knows better."""
    return Setup(
        pid=os.getpid(),
        camera=camera,
        source=config.camera.source,
        intrinsics=lens,
        panels=panels,
        panel_map=panel_map,
        values=values_of(config),
        origins=origins_of(config),
        config_path=None if config.file is None else str(config.file),
    )


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
        "frames_per_s": round((now.ring.published - before.ring.published) / seconds, 2),
        "decoded_per_s": round((now.health.decoded - before.health.decoded) / seconds, 2),
        "frames": now.ring.published,
        "decoded": now.health.decoded,
        "dropped_frames": now.ring.dropped,
        "in_view": now.health.in_view,
        "rejected": dict(sorted(now.health.rejected.items())),
        "temperature_c": status.temperature_c,
        "throttled": status.throttling,
        "wire": {
            "packets": packets.sent,
            "dropped": packets.unsent,
            "port": packets.port,
            "connected": packets.connected,
            "error": packets.error,
            "recent": dict(recent),
        },
    }
