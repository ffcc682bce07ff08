"""`ledpi monitor`: shows what the running daemon sees, or the stream that a motor controller reads."""

from __future__ import annotations

import json
import math
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict
from typing import Annotated, Any

import serial
import typer
from rich.live import Live as Screen

from ledpi import wire
from ledpi.cli import app
from ledpi.core.errors import TapError, WireError
from ledpi.core.wording import counted
from ledpi.daemon.tap.client import Client, connect
from ledpi.daemon.tap.frames import WITH_REASONS, frame_of, not_read_of, read_px_of, why_not_if_told
from ledpi.pipeline.diagnosis.reasons import why_no_fix
from ledpi.pipeline.diagnosis.why_not import WhyNot
from ledpi.wire.line import open_port
from ledpi.workshop.monitor import Live, heading_deg

READ_TIMEOUT_S = 0.1
SHOW_EVERY_S = 0.1
LINE_EVERY_S = 1.0  # where nobody watches
ASK_EVERY_S = 0.5  # for a picture, to say why panels in it are not read
_MAVLINK_MAGIC, _MAVLINK_AROUND = 0xFD, 12  # of version 2: header of 10 bytes, checksum of 2, around the payload
_MAVLINK_LONGEST = 255 + _MAVLINK_AROUND
_POSE_KEYS = ("position_m", "quaternion_wxyz", "deviation_m", "deviation_rad")


@app.command()
def monitor(
    port: Annotated[
        str | None,
        typer.Argument(metavar="PORT", help="Serial port or pty that carries the stream. Default: the running daemon."),
    ] = None,
    baud: Annotated[int, typer.Option(min=1200, help="The sender's serial.baud.")] = 115200,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object a message.")] = False,
    seconds: Annotated[float | None, typer.Option(min=0, help="Stop after this time.")] = None,
    tap: Annotated[str, typer.Option(metavar="SOCKET", help="Without PORT: the daemon's tap.socket.")] = "auto",
) -> None:
    """Watch the running daemon, or print the serial stream.

    Without PORT it shows a table that stays up to date: the panels that the daemon sees, the fix, and the daemon's
    health. Into a pipe or a file it prints one line a second, with --json the lines of the tap. If the daemon
    restarts, it follows the new one. With PORT it prints what a motor controller reads, and at the end how many
    packets were lost or bad. Ends with Ctrl-C, after --seconds, or when the port's other end hangs up. Exit status 2
    if no daemon answers, the port cannot be opened, or it carries MAVLink (use the autopilot's own tools).

    Example: ledpi monitor
    """
    # As Ctrl-C, which a shell's background jobs ignore.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if port is not None:
        _watch_port(port, baud, as_json, seconds)
        return
    with suppress(KeyboardInterrupt):
        (print_lines if as_json else show_table)(tap, seconds)


def _watch_port(port: str, baud: int, as_json: bool, seconds: float | None) -> None:
    receiver = wire.Receiver()
    with open_port(port, baud, read_timeout_s=READ_TIMEOUT_S) as line:
        try:
            hung_up = _show(line, receiver, json_line if as_json else text_line, seconds)
        except KeyboardInterrupt:
            hung_up = False
    if hung_up:
        typer.echo(f"{port}: the other end hung up", err=True)
    typer.echo(summary(receiver.counters), err=True)


def _show(
    line: serial.Serial, receiver: wire.Receiver, render: Callable[[wire.Message], str], seconds: float | None
) -> bool:
    """Prints until the time is over; True if the other end hung up before. Raises WireError where it is MAVLink."""
    end_s = math.inf if seconds is None else time.monotonic() + seconds
    unread = b""  # as long as nothing of it was a packet of ours
    while time.monotonic() < end_s:
        try:
            data = line.read(max(1, line.in_waiting))
        except OSError:
            return True
        for message in receiver.feed(data):
            typer.echo(render(message))
        unread = b"" if receiver.counters.good else (unread + data)[-2 * _MAVLINK_LONGEST :]
        if _is_mavlink(unread):
            raise WireError(
                f"{line.port}: carries MAVLink, which monitor does not read; "
                "set serial.protocol: ledpi, or use MAVLink's own tools, as `mavproxy.py --master=PORT`"
            )
    return False


def _is_mavlink(data: bytes) -> bool:
    """Tells whether one MAVLink 2 frame follows another: magic, payload's length, no signature, ten bytes of header."""
    starts = (at for at in range(len(data) - 2) if data[at] == _MAVLINK_MAGIC and data[at + 2] == 0)
    ends = (at + data[at + 1] + _MAVLINK_AROUND for at in starts)
    return any(end + 2 < len(data) and data[end] == _MAVLINK_MAGIC and data[end + 2] == 0 for end in ends)


def json_line(message: wire.Message) -> str:
    """The fields as in docs/wire.md, a pose's beside the others; null is unknown."""
    values: dict[str, Any] = {"message": message.name} | asdict(message)
    if isinstance(message, wire.StatusMessage):
        values |= {"state": message.state.name.lower(), "no_fix": message.no_fix.name.lower()}
    elif isinstance(message, wire.StateMessage):
        del values["t_ns"]
        values["mode"] = message.mode.name.lower()
    elif isinstance(message, wire.MarkerMessage | wire.FixMessage):
        pose = values.pop("pose") or {}
        values |= {key: pose.get(key) for key in _POSE_KEYS}
    return json.dumps(values)


def text_line(message: wire.Message) -> str:
    """A line for the eye."""
    match message:
        case wire.MarkerMessage():
            return _marker_text(message)
        case wire.FixMessage():
            return _fix_text(message)
        case wire.StatusMessage():
            return _status_text(message)
        case wire.StateMessage():
            return _state_text(message)
        case _:
            return message.name


def _marker_text(m: wire.MarkerMessage) -> str:
    cautions = [name for name in ("uncalibrated", "ambiguous", "alternate") if getattr(m, name)]
    pose = "no pose" if m.pose is None else _pose_text(m.pose)
    return "  ".join([f"marker {m.id:4d}", pose, f"age {m.age_us / 1e3:.1f} ms", *cautions])


def _fix_text(m: wire.FixMessage) -> str:
    parts = [
        f"heading {heading_deg(m.pose.quaternion_wxyz):+.1f}°",
        f"panels {m.panels_used}",
        f"age {m.age_us / 1e3:.1f} ms",
    ]
    return "  ".join(["fix        ", _pose_text(m.pose), *parts])


def _state_text(m: wire.StateMessage) -> str:
    cautions = [name for name in ("contested", "panel_moved") if getattr(m, name)]
    if not (m.position_m and m.deviations and m.velocity) or m.yaw_rad is None:
        return "  ".join(["state       none", *cautions])
    (x, y), (dx, dy, dyaw), (speed, rate) = m.position_m, m.deviations, m.velocity
    parts = [
        f"state       xy {x:+.4f} {y:+.4f} ± {dx:.4f} {dy:.4f} m",
        f"yaw {math.degrees(m.yaw_rad):+.2f} ± {math.degrees(dyaw):.2f}°",
        f"{speed:+.3f} m/s {math.degrees(rate):+.1f}°/s",
        f"by {m.mode.name.lower()}, panels {m.panels}, the newest {m.panel_age_ms} ms ago",
    ]
    return "  ".join([*parts, *cautions])


def _pose_text(pose: wire.WirePose) -> str:
    position = " ".join(f"{v:+.4f}" for v in pose.position_m)
    rotation = " ".join(f"{v:+.4f}" for v in pose.quaternion_wxyz)
    return f"xyz {position}{_deviation_text(pose.deviation_m)} m  wxyz {rotation}" + (
        "" if pose.deviation_rad is None else f"{_deviation_text(pose.deviation_rad)} rad"
    )


def _deviation_text(deviations: tuple[float, float, float] | None) -> str:
    return "" if deviations is None else " ± " + " ".join(f"{d:.4f}" for d in deviations)


def _status_text(m: wire.StatusMessage) -> str:
    fix = "fix" if m.no_fix == 0 else f"no fix: {why_no_fix(m.no_fix.name)}"

    def known(value: int | None, text: str = "{}") -> str:
        return "?" if value is None else text.format(value)

    parts = [
        f"{m.state.name.lower().replace('_', ' ')}, {fix}",
        f"panels {known(m.panels_in_view)}",
        f"{known(m.temperature_c)} °C, throttling {known(m.throttling, '0x{:04x}')}",
        f"up {known(m.uptime_s)} s",
        f"frames {known(m.frames)}, dropped {known(m.frames_dropped)}",
        f"markers {known(m.markers)}",
        f"packets dropped {known(m.packets_dropped)}",
        f"decode {known(m.decode_p50_us)} µs, p99 {known(m.decode_p99_us)} µs",
    ]
    return "  ".join(["status     ", *parts])


def summary(counters: wire.ReceiverCounters) -> str:
    """Says in one line what was received, as in `12 packets, 0 lost, 1 bad (crc 1)`."""

    def by_reason(name: str, counts: dict[Any, int]) -> str:
        detail = ", ".join(f"{reason} {count}" for reason, count in sorted(counts.items()))
        return f"{sum(counts.values())} {name}" + (f" ({detail})" if detail else "")

    text = f"{counters.good} packets, {counters.lost} lost, {by_reason('bad', counters.bad)}"
    if counters.skipped:
        text += f", {by_reason('skipped', counters.skipped)}"
    return text + (f", sender restarted {counted(counters.restarts, 'time')}" if counters.restarts else "")


def print_lines(socket_path: str, seconds: float | None) -> None:
    """Each line of the tap as it is; {"type": "lost"} where the daemon has gone. Raises TapError."""
    with connect(socket_path) as tap:
        for line in _lines(tap, seconds):
            if line["type"] != "tick":
                typer.echo(json.dumps(line))


def show_table(socket_path: str, seconds: float | None) -> None:
    """A table that stays up to date; into a pipe a line a second, and the table at the end. Raises TapError."""
    live, shown_s, asked_s = Live(), -math.inf, -math.inf
    why_not: WhyNot | None = None
    with Screen(auto_refresh=False) as screen, connect(socket_path) as tap:
        for line in _lines(tap, seconds):
            now_s = time.monotonic()
            if line["type"] == "hello":
                why_not = why_not_if_told(line)  # else the counts by reason are told instead
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


def _ask(tap: Client) -> None:
    with suppress(TapError):  # it is gone: `lines` says so
        tap.send("picture", **{"with": list(WITH_REASONS)})


def _lines(tap: Client, seconds: float | None) -> Iterator[dict[str, Any]]:
    end_s = math.inf if seconds is None else time.monotonic() + seconds
    for line in tap.lines(reconnect=True, tick_s=SHOW_EVERY_S):
        yield line
        if time.monotonic() >= end_s:
            return
