"""`ledpi monitor` without a port: the running daemon, as its tap tells of it."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import typer

from ledpi.core.errors import TapError

if TYPE_CHECKING:
    from ledpi.diagnosis.why_not import WhyNot
    from ledpi.tap.client import Client

SHOW_EVERY_S = 0.1
LINE_EVERY_S = 1.0  # where nobody watches
ASK_EVERY_S = 0.5  # for a picture, to say why panels in it are not read


def print_lines(socket_path: str, seconds: float | None) -> None:
    """Each line of the tap as it is; {"type": "lost"} where the daemon has gone. Raises TapError."""
    from ledpi.tap.client import connect

    with connect(socket_path) as tap:
        for line in _lines(tap, seconds):
            if line["type"] != "tick":
                typer.echo(json.dumps(line))


def show_table(socket_path: str, seconds: float | None) -> None:
    """A table that stays up to date; into a pipe a line a second, and the table at the end. Raises TapError."""
    from rich.live import Live as Screen

    from ledpi.tap.client import connect
    from ledpi.tap.frames import frame_of, not_read_of, read_px_of
    from ledpi.tools.monitor import Live

    live, shown_s, asked_s = Live(), -math.inf, -math.inf
    why_not: WhyNot | None = None
    with Screen(auto_refresh=False) as screen, connect(socket_path) as tap:
        for line in _lines(tap, seconds):
            now_s = time.monotonic()
            if line["type"] == "hello":
                why_not = _why_not(line)
            elif line["type"] == "picture" and why_not is not None:
                frame = frame_of(tap.hello, line)
                live.explain(why_not.explain_at_once(frame, not_read_of(line), read_px_of(line)))
            live.take(line)
            if why_not is not None and now_s - asked_s >= ASK_EVERY_S:
                asked_s = now_s
                _ask(tap)
            if now_s - shown_s >= (SHOW_EVERY_S if screen.console.is_terminal else LINE_EVERY_S):
                shown_s = now_s
                if screen.console.is_terminal:
                    screen.update(live.shown(now_s), refresh=True)
                elif line["type"] != "hello":
                    typer.echo(live.line(now_s))
        screen.update(live.shown(time.monotonic()), refresh=True)


def _why_not(hello: dict[str, Any]) -> WhyNot | None:
    from ledpi.tap.frames import why_not_of

    try:
        return why_not_of(hello)
    except TapError:  # a dictionary that cannot be read from here: the counts by reason are told instead
        return None


def _ask(tap: Client) -> None:
    from ledpi.tap.frames import WITH_REASONS

    with suppress(TapError):  # it is gone: `lines` says so
        tap.send("picture", **{"with": list(WITH_REASONS)})


def _lines(tap: Client, seconds: float | None) -> Iterator[dict[str, Any]]:
    end_s = math.inf if seconds is None else time.monotonic() + seconds
    for line in tap.lines(reconnect=True, tick_s=SHOW_EVERY_S):
        yield line
        if time.monotonic() >= end_s:
            return
