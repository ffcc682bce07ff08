"""`ledpi monitor` without a port: the running daemon, as its tap tells of it."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator
from typing import Any

import typer

SHOW_EVERY_S = 0.1


def print_lines(socket_path: str, seconds: float | None) -> None:
    """Each line of the tap as it is; {"type": "lost"} where the daemon has gone. Raises TapError."""
    for line in _lines(socket_path, seconds):
        if line["type"] != "tick":
            typer.echo(json.dumps(line))


def show_table(socket_path: str, seconds: float | None) -> None:
    """A table that stays up to date; where nobody watches, as in a pipe, once at the end. Raises TapError."""
    from rich.live import Live as Screen

    from ledpi.tools.monitor.table import Live

    live, shown_s = Live(), -math.inf
    with Screen(auto_refresh=False) as screen:
        for line in _lines(socket_path, seconds):
            live.take(line)
            now_s = time.monotonic()
            if now_s - shown_s >= SHOW_EVERY_S:
                shown_s = now_s
                screen.update(live.shown(now_s), refresh=True)
        screen.update(live.shown(time.monotonic()), refresh=True)


def _lines(socket_path: str, seconds: float | None) -> Iterator[dict[str, Any]]:
    from ledpi.tap.client import connect

    end_s = math.inf if seconds is None else time.monotonic() + seconds
    with connect(socket_path) as tap:
        for line in tap.lines(reconnect=True, tick_s=SHOW_EVERY_S):
            yield line
            if time.monotonic() >= end_s:
                return
