"""The tap's lines as a table that a person watches: a row for each panel, the fix, and how the daemon is."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from ledpi.core.geometry import matrix_from_quaternion
from ledpi.core.wording import one_line
from ledpi.pipeline.diagnosis.reasons import explained, why_no_fix
from ledpi.workshop.doctor.running import checks

if TYPE_CHECKING:
    from ledpi.pipeline.diagnosis.why_not import Why
    from ledpi.workshop.doctor.finding import Finding

RATE_NS = 2_000_000_000  # over which detections are counted
GONE_S = 10.0  # after which a panel that is not seen leaves the table
OLD_S = 0.5  # from which on its row is dim
MOST_REASONS = 4
_NO_POSE = "–"


@dataclass(slots=True)
class _Seen:
    marker: dict[str, Any]
    exposed_ns: int
    times_ns: deque[int] = field(default_factory=deque)


class PanelTable:
    """Follows the lines `decoded`."""

    def __init__(self, forgotten_s: float) -> None:
        """`forgotten_s`: after so long unseen, a panel is no row any more."""
        self._forgotten_ns = forgotten_s * 1e9
        self._seen: dict[int, _Seen] = {}

    def see(self, decoded: dict[str, Any]) -> None:
        """Takes in the markers of a frame."""
        now_ns = decoded["exposed_ns"]
        for marker in decoded["markers"]:
            seen = self._seen.setdefault(marker["id"], _Seen(marker, now_ns))
            seen.marker, seen.exposed_ns = marker, now_ns
            seen.times_ns.append(now_ns)
            while seen.times_ns[0] < now_ns - RATE_NS:
                seen.times_ns.popleft()

    def rows(self, now_ns: float) -> list[dict[str, Any]]:
        """By ID. `now_ns`: CLOCK_MONOTONIC; ages are since mid-exposure, rates of the two seconds before."""
        self._seen = {i: seen for i, seen in self._seen.items() if now_ns - seen.exposed_ns < self._forgotten_ns}
        return [_row(marker_id, seen, now_ns) for marker_id, seen in sorted(self._seen.items())]


def _row(marker_id: int, seen: _Seen, now_ns: float) -> dict[str, Any]:
    within = sum(1 for t in seen.times_ns if now_ns - t < RATE_NS)
    return {
        "id": marker_id,
        **place_of(seen.marker),
        "age_ms": round((now_ns - seen.exposed_ns) / 1e6, 1),
        "rate_hz": round(within / (RATE_NS / 1e9), 1),
        "margin": seen.marker["margin"],
        "ambiguous": seen.marker.get("alternate") is not None,
    }


def place_of(marker: dict[str, Any]) -> dict[str, float | None]:
    """Tells how far a panel is, and by how much it is turned to the side."""
    if marker["position_m"] is None:
        return {"distance_m": None, "yaw_deg": None}
    turned_deg = yaw_deg(marker["quaternion_wxyz"])
    return {"distance_m": round(math.hypot(*marker["position_m"]), 4), "yaw_deg": round(turned_deg, 1)}


class Live:
    """Fed with lines, in their order; shown whenever somebody looks."""

    def __init__(self) -> None:
        self._hello: dict[str, Any] = {}
        self._health: dict[str, Any] = {}
        self._before: dict[str, int] = {}  # rejected, a second before
        self._panels = PanelTable(GONE_S)
        self._fix: tuple[dict[str, Any], float] | None = None
        self._state: dict[str, Any] | None = None  # of the robot
        self._wrong: list[Finding] = []
        self._why: Why | None = None  # of the newest picture that was explained
        self._dropped = 0
        self._lost = False

    def take(self, line: dict[str, Any]) -> None:
        """A line of the tap; of an unknown type it is passed over."""
        kind = line["type"]
        if kind == "lost":
            self._lost = True
        elif kind == "hello":
            self._hello, self._health, self._before, self._why, self._lost = line, {}, {}, None, False
            self._state = None
        elif kind == "health":
            self._before, self._health = self._health.get("rejected", {}), line
            self._wrong = [finding for finding in checks(self._hello, line) if finding.state == "bad"]
        elif kind == "robot_state":
            self._state = line
        elif kind == "decoded":
            self._decoded(line)

    def explain(self, why: Why) -> None:
        """Why panels are not read, of the newest picture."""
        self._why = why

    def _decoded(self, line: dict[str, Any]) -> None:
        self._dropped = line["dropped"]
        self._panels.see(line)
        if line["robot"] is not None:
            self._fix = line["robot"], line["exposed_ns"] * 1e-9

    def shown(self, now_s: float) -> RenderableType:
        """As it is at this time of CLOCK_MONOTONIC."""
        table = Table(box=None, pad_edge=False, header_style="bold")
        for name in ("ID", "distance", "yaw", "age", "rate", "margin"):
            table.add_column(name, justify="right")
        for row in self._panels.rows(1e9 * now_s):
            table.add_row(str(row["id"]), *_cells(row), style="dim" if row["age_ms"] > 1e3 * OLD_S else "")
        nothing = Text("no panel seen in the last 10 s", style="dim")
        panels = table if table.row_count else nothing
        told = (
            *self._why_lines(),
            *self._wrong_lines(),
            self._fix_line(now_s),
            *self._state_lines(),
            *self._health_lines(),
        )
        return Group(self._daemon(), panels, *told)

    def line(self, now_s: float) -> str:
        """The same in one line, for a log: `ID 7 1.002 m +0.4° | no fix: no map is set | running, 58 frames/s`."""
        if self._lost:
            return self._daemon().plain
        seen = [
            f"ID {row['id']} {' '.join(_cells(row)[:2])}"
            for row in self._panels.rows(1e9 * now_s)
            if row["age_ms"] <= 1e3 * OLD_S
        ]
        health = self._health
        state = [f"{health['state'].replace('_', ' ')}, {health['frames_per_s']:.0f} frames/s"] if health else []
        told, where = (*self._why_lines(), *self._wrong_lines()), (one.plain for one in self._state_lines())
        parts = [
            ", ".join(seen) or "no panel",
            self._fix_line(now_s).plain,
            *where,
            *state,
            *(one.plain for one in told),
        ]
        return one_line(" | ".join(parts))

    def _wrong_lines(self) -> list[Text]:
        """Says what is wrong with the daemon, as `ledpi doctor` tells it."""
        if self._lost:
            return []
        return [Text(f"{one.name}: {one.said}; {one.remedy}", style="yellow") for one in self._wrong]

    def _why_lines(self) -> list[Text]:
        """Says what is not read, and why."""
        if self._why is None or self._lost:
            return []
        told = self._why.told[:MOST_REASONS]
        lines = [(one.line, one.helps) for one in told] + [(note.says, note.helps) for note in self._why.notes]
        return [Text(f"{says}; {helps}" if helps else says, style="yellow") for says, helps in lines]

    def _daemon(self) -> Text:
        if self._lost:
            return Text("the daemon is gone; waiting for it to come back", style="bold red")
        camera = self._hello.get("camera", {})
        size = f"{camera.get('width')}×{camera.get('height')}"
        return Text(f"ledpi {self._hello.get('version')}, pid {self._hello.get('pid')}, {camera.get('source')} {size}")

    def _fix_line(self, now_s: float) -> Text:
        if self._fix is None or now_s - self._fix[1] > GONE_S:
            return Text(f"no fix: {why_no_fix(str(self._health.get('no_fix', '?')))}", style="yellow")
        robot, at_s = self._fix
        x, y, z = robot["position_m"]
        heading = heading_deg(robot["quaternion_wxyz"])
        used = ", ".join(str(marker_id) for marker_id in robot["panels_used"])
        said = f"fix: x {x:+.3f} y {y:+.3f} z {z:+.3f} m, heading {heading:+.1f}°, by {used}, {_age(now_s - at_s)} old"
        return Text(said, style="dim" if now_s - at_s > OLD_S else "green")

    def _state_lines(self) -> list[Text]:
        """Says where the robot is between panels, where the daemon tells it."""
        state = self._state
        if state is None or self._lost:
            return []
        if state["position_m"] is None:
            return [Text("no state: no panel that leaves no choice has been seen", style="yellow")]
        x, y = state["position_m"]
        deviations = np.sqrt(np.diag(np.reshape(state["covariance"], (3, 3))))
        mm, deg = 1e3 * max(deviations[:2]), math.degrees(deviations[2])
        said = (
            f"state: x {x:+.3f} y {y:+.3f} m ± {mm:.0f} mm, heading {math.degrees(state['yaw_rad']):+.1f} ± {deg:.1f}°"
        )
        by = "by odometry" if state["mode"] == "odometry" else "without odometry"
        seen = f"{by}, a panel {_age((state['t_ns'] - state['panel_ns']) * 1e-9)} ago"
        doubt = [*(["contested"] if state["contested"] else []), *(f"panel {i} has moved" for i in state["moved"])]
        return [Text(", ".join([said, seen, *doubt]), style="yellow" if doubt else "green")]

    def _health_lines(self) -> list[Text]:
        health = self._health
        if not health:
            return [Text("…", style="dim")]
        latency, wire = health["latency_ms"], health["wire"]
        late = "?" if latency is None else f"{latency['median']:.1f} ms, worst {latency['worst']:.1f} ms"
        heat = "" if health["temperature_c"] is None else f", {health['temperature_c']} °C"
        port = "port open" if wire["connected"] else "no port"
        pace = f"{health['frames_per_s']:.0f} frames/s, {health['decoded_per_s']:.0f} decoded/s"
        lines = [
            f"{health['state'].replace('_', ' ')}: {pace}, {health['dropped_frames']} dropped",
            f"latency {late}{heat}; {port}, {wire['packets']} packets",
            f"missed by this monitor: {self._dropped}" if self._dropped else "",
            *(f"newest warning: {fault['text']}" for fault in health["faults"][-1:]),
            *(self._reasons() if self._why is None else ()),
        ]
        return [Text(line, style="dim", overflow="ellipsis", no_wrap=True) for line in lines if line]

    def _reasons(self) -> list[str]:
        """Says what was dropped in the last second, how often and why; last what was never fitted: lamps, mostly."""
        now = self._health["rejected"]
        new = {key: count - self._before.get(key, 0) for key, count in now.items()} if self._before else {}
        most = sorted((key for key in new if new[key] > 0), key=lambda key: (key.startswith("find."), -new[key]))
        return [f"not read, {new[key]}×: {_in_words(key)}" for key in most[:MOST_REASONS]]


def _in_words(key: str) -> str:
    means, helps = explained(key)
    return f"{means} ({helps})" if helps else means


def _cells(row: dict[str, Any]) -> list[str]:
    where = [_NO_POSE, _NO_POSE]
    if row["distance_m"] is not None:
        where = [f"{row['distance_m']:.3f} m", f"{row['yaw_deg']:+.1f}°"]
    return [*where, _age(row["age_ms"] / 1e3), f"{row['rate_hz']:.0f}/s", f"{row['margin']:.0f}"]


def yaw_deg(quaternion_wxyz: list[float]) -> float:
    """By how much a panel (camera_from_marker) is turned to the side: 0 faces the camera, + shows its left edge closer.

    About the picture's vertical axis, −180 to 180.
    """
    x, _, z = matrix_from_quaternion(np.array(quaternion_wxyz))[:, 2]
    return math.degrees(math.atan2(x, -z))


def heading_deg(quaternion_wxyz: Sequence[float]) -> float:
    """Returns that of the robot in the map: 0 looks along x, + turns to y."""
    w, x, y, z = quaternion_wxyz
    return math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


def _age(seconds: float) -> str:
    return f"{1e3 * seconds:.0f} ms" if seconds < 1 else f"{seconds:.1f} s"
