"""One estimate of where the robot is, from odometry and panels, at every moment."""

from __future__ import annotations

import math
from collections.abc import Iterable

from ledpi.core.records import Floats, MarkerPose, Rejected, read_only
from ledpi.pose.panel_map import PanelMap
from ledpi.state.belief import Belief, Judge
from ledpi.state.filter import Filter
from ledpi.state.motion import SPEED, TURN
from ledpi.state.planar import look_of
from ledpi.state.records import NO_NUMBER, NOT_IN_MAP, NOT_STARTED, Look, Odometry, OdometryNoise, State
from ledpi.state.ring import Head, Ring

MOST_STEP_NS = 100_000_000  # of motion as before, by which a report goes beyond the newest input at once


class Estimator:
    """The state of one robot. Times are of one clock; `now_ns` is when an input arrived."""

    def __init__(self, panels: PanelMap, base_from_camera: Floats, noise: OdometryNoise | None = None) -> None:
        noise = noise or OdometryNoise()
        self._panels, self._base_from_camera = panels, base_from_camera
        seat = float(base_from_camera[0, 3]), float(base_from_camera[1, 3])
        empty = Filter(panels, seat, noise)
        self._ring = Ring(Head(Judge(empty, Belief(empty.copy())), noise))

    def add_markers(self, markers: Iterable[MarkerPose], now_ns: int) -> tuple[Rejected, ...]:
        """Takes the panels of a frame. Returns why some tell nothing of the robot."""
        rejected = []
        for marker in markers:
            panel = self._panels.get(marker.detection.id)
            look = NOT_IN_MAP if panel is None else look_of(marker, panel, self._base_from_camera)
            rejected.append(look if isinstance(look, Rejected) else self._ring.add(look, now_ns))
        return tuple(each for each in rejected if each is not None)

    def add_look(self, look: Look, now_ns: int) -> Rejected | None:
        """Takes one panel."""
        if look.panel not in self._panels:
            return NOT_IN_MAP
        return self._ring.add(look, now_ns)

    def add_odometry(self, odometry: Odometry, now_ns: int) -> Rejected | None:
        """Takes a message of the controller. Returns why it tells nothing."""
        if not all(value is None or math.isfinite(value) for value in odometry.totals):
            return NO_NUMBER
        return self._ring.add(odometry, now_ns)

    def at(self, t_ns: int) -> State | Rejected:
        """The state at a time, or at that of the newest input where that is later; nothing changes by it."""
        head = self._ring.head.copy()
        if head.t_ns is None:
            return NOT_STARTED
        latest_ns = head.t_ns if head.last is None else max(head.t_ns, head.last.t_ns)
        head.advance(latest_ns)
        for until_ns in range(latest_ns + MOST_STEP_NS, t_ns + MOST_STEP_NS, MOST_STEP_NS):
            if not head.judge.belief.filter.has_pose:
                break
            head.advance(min(t_ns, until_ns))
        judge, own = head.judge, head.judge.belief.filter
        if not own.has_pose:
            return NOT_STARTED
        pose, covariance = judge.report()
        return State(
            t_ns=head.t_ns,
            pose=read_only(pose),
            covariance=read_only(covariance),
            speed_m_s=float(own.x[SPEED]),
            turn_rad_s=float(own.x[TURN]),
            panel_ns=judge.used_ns,
            panels=own.panels,
            contested=judge.rival is not None,
            moved=tuple(sorted(judge.moved)),
            relocalisations=judge.relocalisations,
            events=judge.events,
        )
