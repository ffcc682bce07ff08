"""One estimate of where the robot is, from odometry and panels, at every moment.

Inputs are kept for 2 s in the order of their own times. A look that was exposed 60 ms ago is put in its place, and what
came after it is done once more from the snapshot before it. So the state does not depend, by no bit, on what came when.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from ledpi.core.records import Floats, MarkerPose, PanelMap, Rejected, read_only
from ledpi.state.belief import Belief, Event, Judge
from ledpi.state.filter import Filter
from ledpi.state.inputs import (
    SILENT_NS,
    SPEED,
    TURN,
    Look,
    Odometry,
    OdometryNoise,
    Step,
    are_linked,
    between,
    look_of,
    step_between,
)

NOT_STARTED = Rejected(stage="state", reason="not_started")
NOT_IN_MAP = Rejected(stage="state", reason="not_in_map")
TOO_OLD = Rejected(stage="state", reason="too_old")
IN_FUTURE = Rejected(stage="state", reason="in_future")
NO_NUMBER = Rejected(stage="state", reason="no_number")
LEAP = Rejected(stage="state", reason="odometry_leap")

KEPT_NS, FORGOTTEN_AT_ONCE_NS = 2_000_000_000, 500_000_000
SPAN_NS = 50_000_000  # between snapshots; of a panel's looks in each span the first is used: more say nothing new
EARLY_NS = 20_000_000  # by which two clocks may differ
Input = Odometry | Look
_time = attrgetter("t_ns")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class State:
    """map_from_base_link in the plane at a moment."""

    t_ns: int
    pose: Floats  # (3,) x, y, yaw
    covariance: Floats  # (3, 3); spans both while another pose is possible
    speed_m_s: float
    turn_rad_s: float
    panel_ns: int  # when a panel was last used
    way_m: float  # driven since
    by_odometry: bool  # else none was heard of late, and it goes on as it moved
    panels: int  # that are followed in the state
    contested: bool  # another pose is possible
    moved: tuple[int, ...]  # panels that hang elsewhere than the map says
    relocalisations: int
    mount_rad: Floats  # (2, 3) how far the camera is turned about x, y, z from where it is believed; deviations
    events: tuple[Event, ...]  # the last ones


class Head:
    """The state after some inputs. Messages of odometry add up, as an arc, until a span ends or a panel is seen."""

    def __init__(self, judge: Judge, noise: OdometryNoise) -> None:
        self.judge, self._noise = judge, noise
        self.t_ns: int | None = None  # at which `judge` holds; `last` may be later
        self.base: Odometry | None = None  # the totals at `t_ns`, where they are known
        self.last: Odometry | None = None
        self._spans: dict[int, int] = {}  # of each panel's last look

    def copy(self) -> Head:
        other = copy(self)
        other.judge, other._spans = self.judge.copy(), self._spans.copy()
        return other

    def advance(self, t_ns: int, following: Odometry | None = None) -> None:
        """Moves to a time: by odometry as far as it goes, the `following` message included, and then on as it moved."""
        last = self.last
        if self.base is not None and last is not None:
            if following is not None and t_ns > last.t_ns and are_linked(last, following):
                last = between(last, following, t_ns)
            if last.t_ns > self.base.t_ns:
                self.judge.propagate(step_between(self.base, last, self._noise))
                self.t_ns, self.base = last.t_ns, last
        before, self.t_ns = self.t_ns, max(t_ns, self.t_ns or t_ns)
        if before is not None and self.t_ns > before:
            self.base = None
            self.judge.propagate(Step((self.t_ns - before) * 1e-9))

    def take(self, what: Input, following: Odometry | None) -> None:
        """Takes an input; `following` is the next message of odometry after a look."""
        if isinstance(what, Look):
            span = what.t_ns // SPAN_NS
            if self._spans.get(what.panel) != span:
                self._spans[what.panel] = span
                self.advance(what.t_ns, following)
                self.judge.hear(what)
            return
        if self.last is None or self.base is None or not are_linked(self.last, what):
            self.advance(what.t_ns)
            self.base = what
        elif what.slipping or self.last.slipping:
            self.advance(self.last.t_ns)
        before, self.last = self.t_ns, what
        if before is None or what.t_ns // SPAN_NS > before // SPAN_NS:
            self.advance(what.t_ns)
        if what.lifted:
            self.judge.belief.filter.has_pose, self.judge.rival = False, None  # it may be anywhere
            self.judge.trust.looks.clear()  # nobody knows how it moved since


class Estimator:
    """The state of one robot. Times are of one clock; `now_ns` is when an input arrived."""

    def __init__(self, panels: PanelMap, base_from_camera: Floats, noise: OdometryNoise | None = None) -> None:
        noise = noise or OdometryNoise()
        self._panels, self._base_from_camera = panels, base_from_camera
        empty = Filter(panels, (float(base_from_camera[0, 3]), float(base_from_camera[1, 3])))
        self._head = Head(Judge(empty, Belief(empty.copy())), noise)
        self._inputs: list[Input] = []
        self._taken = 0  # of them by the head; an earlier one that has changed is done again, and all after it
        self._keys: list[tuple[int, int]] = []  # of each: its time; -1 of odometry, else the panel
        self._odometry: list[Odometry] = []
        self._first_ns: dict[tuple[int, int], int] = {}  # of a span's looks at a panel
        self._snapshots: list[tuple[int, Head]] = []  # each before the input of that number

    def add_markers(self, markers: Iterable[MarkerPose], now_ns: int) -> tuple[Rejected, ...]:
        """Takes the panels of a frame. Returns why some tell nothing of the robot."""
        new = (marker for marker in markers if not self._is_known(marker.mid_exposure_ns, marker.detection.id))
        panels = [(marker, self._panels.get(marker.detection.id)) for marker in new]
        looks = [NOT_IN_MAP if p is None else look_of(marker, p, self._base_from_camera) for marker, p in panels]
        return self.add_looks(looks, now_ns)

    def add_look(self, look: Look, now_ns: int) -> Rejected | None:
        """Takes one panel."""
        return next(iter(self.add_looks((look,), now_ns)), None)

    def add_looks(self, looks: Iterable[Look | Rejected], now_ns: int) -> tuple[Rejected, ...]:
        """Takes the panels of a frame, all at once, as what came after them is done again."""
        told = [look if isinstance(look, Rejected) else self._add(look, now_ns) for look in looks]
        self._catch_up()
        return tuple(each for each in told if each is not None)

    def add_odometry(self, odometry: Odometry, now_ns: int) -> Rejected | None:
        """Takes a message of the controller. Returns why it tells nothing."""
        if not all(value is None or math.isfinite(value) for value in odometry.totals):
            return NO_NUMBER
        rejected = self._add(odometry, now_ns)
        self._catch_up()
        return rejected

    def at(self, t_ns: int) -> State | Rejected:
        """The state at a time, or at that of the newest input where that is later; nothing changes by it.

        Raises FloatingPointError where that is no number.
        """
        head = copy(self._head)
        if head.t_ns is None:
            return NOT_STARTED
        head.judge = head.judge.ahead()
        latest_ns = head.t_ns if head.last is None else max(head.t_ns, head.last.t_ns)
        head.advance(latest_ns)
        for until_ns in range(latest_ns + SPAN_NS, t_ns + SPAN_NS, SPAN_NS):
            if not head.judge.belief.filter.has_pose:
                break
            head.advance(min(t_ns, until_ns))
        judge, own = head.judge, head.judge.belief.filter
        if not own.has_pose:
            return NOT_STARTED
        pose, covariance = judge.report()
        if not (np.isfinite(pose).all() and np.isfinite(covariance).all()):
            raise FloatingPointError(f"the state is no number: {pose} {covariance.diagonal()}")
        return State(
            t_ns=head.t_ns,
            pose=read_only(pose),
            covariance=read_only(covariance),
            speed_m_s=float(own.x[SPEED]),
            turn_rad_s=float(own.x[TURN]),
            panel_ns=judge.used_ns,
            way_m=judge.way_m,
            by_odometry=head.last is not None and head.t_ns - head.last.t_ns <= SILENT_NS and not judge.trust.is_lost,
            panels=len(own.slots),
            contested=judge.rival is not None,
            moved=tuple(sorted(judge.moved)),
            relocalisations=judge.relocalisations,
            mount_rad=read_only(own.mount),
            events=judge.events,
        )

    def _is_known(self, t_ns: int, panel: int) -> bool:
        """Tells whether an earlier look of the same span is there, beside which this one says nothing new."""
        return self._first_ns.get((t_ns // SPAN_NS, panel), t_ns + 1) <= t_ns

    def _add(self, what: Input, now_ns: int) -> Rejected | None:
        """Puts an input that arrives at `now_ns` in its place. Returns why it is not used."""
        if what.t_ns > now_ns + EARLY_NS:
            return IN_FUTURE
        if self._inputs and what.t_ns < self._inputs[-1].t_ns - KEPT_NS:
            return TOO_OLD
        if isinstance(what, Look):
            if what.panel not in self._panels:
                return NOT_IN_MAP
            if self._is_known(what.t_ns, what.panel):
                return None
            self._first_ns[what.t_ns // SPAN_NS, what.panel] = what.t_ns
        key = (what.t_ns, what.panel if isinstance(what, Look) else -1)
        at = changed = bisect_left(self._keys, key)
        if self._keys[at : at + 1] == [key]:
            return None
        rejected = None
        if isinstance(what, Odometry):
            k = bisect_left(self._odometry, what.t_ns, key=_time)
            previous = self._odometry[k - 1] if k else what
            self._odometry.insert(k, what)
            if what.t_ns - previous.t_ns <= SILENT_NS:
                changed = min(at, bisect_right(self._keys, (previous.t_ns, -1)))  # what is between hangs on both
                rejected = None if what.restarted or are_linked(previous, what) else LEAP
        self._inputs.insert(at, what)
        self._keys.insert(at, key)
        if changed < self._taken:
            while self._snapshots[-1][0] > changed:
                self._snapshots.pop()
            self._taken, snapshot = self._snapshots[-1]
            self._head = snapshot.copy()
        return rejected

    def _catch_up(self) -> None:
        """Takes all inputs that are not taken."""
        for at in range(self._taken, len(self._inputs)):
            t_ns = self._inputs[at].t_ns
            if not self._snapshots or t_ns - self._inputs[self._snapshots[-1][0]].t_ns >= SPAN_NS:
                self._snapshots.append((at, self._head.copy()))
            k = bisect_left(self._odometry, t_ns, key=_time)
            self._head.take(self._inputs[at], self._odometry[k] if k < len(self._odometry) else None)
        self._taken = len(self._inputs)
        if self._inputs:
            self._forget()

    def _forget(self) -> None:
        """Drops what nothing can come before any more, from time to time."""
        oldest_ns = self._inputs[-1].t_ns - KEPT_NS
        if self._inputs[0].t_ns > oldest_ns - FORGOTTEN_AT_ONCE_NS:
            return
        kept = max(k for k, (at, _) in enumerate(self._snapshots) if self._inputs[at].t_ns <= oldest_ns)
        cut = self._snapshots[kept][0]
        linked_ns = self._inputs[cut].t_ns - SILENT_NS
        self._taken -= cut
        del self._inputs[:cut], self._keys[:cut], self._odometry[: bisect_left(self._odometry, linked_ns, key=_time)]
        self._snapshots = [(at - cut, head) for at, head in self._snapshots[kept:]]
        self._first_ns = {span: t_ns for span, t_ns in self._first_ns.items() if t_ns >= oldest_ns}
