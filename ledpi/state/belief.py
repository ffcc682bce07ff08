"""A filter that may be wrong: the robot was carried off, or a panel hangs elsewhere than the map says.

What a look at a panel refuses begins a rival: the same filter, started at what that panel says. Each has its witnesses,
panels that agree with it. No panel is a witness in its own case, and two must agree before a third is accused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from ledpi.core.records import MAX_GAP_NS, Floats
from ledpi.pose.branches import EXCLUDED_BY
from ledpi.state.filter import GATE, MIRROR_LEAD, Filter, Innovation
from ledpi.state.inputs import POSE, SPEED, YAW, Look, Step, wrapped
from ledpi.state.trust import Trust

MISPLACED = 0.5**2  # variance, m² and rad², of how far off a panel is that was hung or measured wrong
AGREES = -EXCLUDED_BY / 2  # χ² by which a look says that its panel hangs right, and no other way
REPEATED = 3  # looks, 50 ms apart, that are no slip of the decoder
SETTLES_NS = 500_000_000  # a panel that agreed before, and for so long only with the rival, shows that the robot moved


@dataclass(frozen=True, slots=True)
class Event:
    """Something that somebody should know of."""

    t_ns: int
    kind: Literal["panel_moved", "relocalised", "map_contradicts", "odometry_contradicts", "mount_contradicts"]
    panel: int


@dataclass(slots=True)
class Belief:
    """A filter, and the panels that it rests on."""

    filter: Filter
    # Those that agree with it, and the pose's covariance before they were first seen; None of the one it began with.
    witnesses: dict[int, Floats | None] = field(default_factory=dict)
    seen_ns: dict[int, int] = field(default_factory=dict)
    asked: dict[int, tuple[int, int, float]] = field(default_factory=dict)  # when last, how often in turn, mean answer

    def copy(self) -> Belief:
        return Belief(self.filter.copy(), self.witnesses.copy(), self.seen_ns.copy(), self.asked.copy())

    def start(self, look: Look) -> None:
        self.filter.start(look)
        self.witnesses, self.seen_ns, self.asked = {look.panel: None}, {look.panel: look.t_ns}, {}

    def hear(self, look: Look, innovation: Innovation) -> bool:
        """Uses a look, if it may be of where the robot is. Returns whether.

        The gate decides. But if the state rests on one panel, the first look at another for a while must agree, which
        makes it a witness; later ones find its own word in the state. Too vague a state rests on this one from now on.
        """
        panel = look.panel
        if innovation.chi2 > GATE[len(innovation.error)]:
            return False
        if panel not in self.witnesses and look.t_ns - self.seen_ns.get(panel, -MAX_GAP_NS) >= MAX_GAP_NS:
            agrees, is_vague = self._ask(look, innovation) <= AGREES, evidence(innovation, 0.0) > AGREES
            if agrees:
                self.witnesses[panel] = self.filter.covariance
            elif is_vague and look.alternate is None:
                self.witnesses = {panel: None}
            elif not is_vague and len(self.witnesses) < 2:
                return False
        self.seen_ns[panel] = look.t_ns
        self.filter.update(innovation)
        return True

    def _ask(self, look: Look, innovation: Innovation) -> float:
        """Returns the evidence of a panel's looks in turn, their mean: one of many would agree by chance."""
        before_ns, looks, mean = self.asked.get(look.panel, (-MAX_GAP_NS, 0, 0.0))
        if look.t_ns - before_ns >= MAX_GAP_NS:
            looks, mean = 0, 0.0
        mean += (evidence(innovation) - mean) / (looks + 1)
        self.asked[look.panel] = look.t_ns, looks + 1, mean
        return mean


@dataclass(slots=True)
class Rival:
    """Another belief, begun by a panel that the first refused, and how looks have taken sides since."""

    belief: Belief
    founder: int
    begun_ns: int
    agreed_before: bool  # the founder was a witness of the first
    looks: int = 1  # that agree with the rival only
    neither: int = 0  # looks in turn that both refuse
    against: dict[int, int] = field(default_factory=dict)  # looks at others that agree with the first only, by panel

    def copy(self) -> Rival:
        return replace(self, belief=self.belief.copy(), against=self.against.copy())


@dataclass(slots=True)
class Judge:
    """The belief and its rival, changed by one look after the other."""

    empty: Filter  # to begin with
    belief: Belief
    rival: Rival | None = None
    trust: Trust = field(default_factory=Trust)
    moved: dict[int, int] = field(default_factory=dict)  # who hangs elsewhere, and looks at each that agree after all
    contradicting: frozenset[int] = frozenset()
    mount_contradicts: bool = False
    relocalisations: int = 0
    used_ns: int = 0
    way_m: float = 0.0  # driven since, forward or back
    events: tuple[Event, ...] = ()

    def copy(self) -> Judge:
        rival = None if self.rival is None else self.rival.copy()
        return replace(self, belief=self.belief.copy(), rival=rival, trust=self.trust.copy(), moved=self.moved.copy())

    def ahead(self) -> Judge:
        """Copies no more than looking ahead takes: it hears nothing."""
        rival, trust = self.rival, Trust(is_lost=self.trust.is_lost)
        if rival is not None:
            rival = replace(rival, belief=Belief(rival.belief.filter.ahead()))
        return replace(self, belief=Belief(self.belief.filter.ahead()), rival=rival, trust=trust)

    def propagate(self, step: Step) -> None:
        """Moves both; without odometry, if it contradicts the panels."""
        self.trust.moved = self.trust.moved.after(step)
        if self.trust.is_lost:
            step = Step(step.dt_s)
        self.belief.filter.propagate(step)
        self.way_m += abs(float(self.belief.filter.x[SPEED]) * step.dt_s)  # the speed is the step's, if it was measured
        if self.rival is not None:
            self.rival.belief.filter.propagate(step)
            if not self.rival.belief.filter.has_pose:
                self.rival = None

    def hear(self, look: Look) -> None:
        """Takes a look into account."""
        if self.trust.hear(look, self.belief.filter.contradicts_odometry):
            self.belief, self.rival, self.moved = Belief(self.empty.copy()), None, {}
            self.relocalisations += 1
            self._tell(Event(look.t_ns, "odometry_contradicts", look.panel))
        belief, panel = self.belief, look.panel
        if not belief.filter.has_pose:
            if look.alternate is None and panel not in self.moved:
                belief.start(look)
                self.rival, self.used_ns, self.way_m = None, look.t_ns, 0.0
            return
        innovation = belief.filter.compare(look)
        if panel in self.moved:
            self._pardon(panel, innovation)
            return
        doubted = self.rival is not None and self.rival.founder == panel and evidence(innovation) > AGREES
        if not doubted and belief.hear(look, innovation):
            self.used_ns, self.way_m = look.t_ns, 0.0
            self._accepted(look, innovation.chi2)
        else:
            self._refused(look)
        rests_on_others = len(self.belief.witnesses.keys() - {panel}) >= 2
        if rests_on_others and panel not in self.contradicting and self.belief.filter.contradicts_map(panel):
            self.contradicting |= {panel}
            self._tell(Event(look.t_ns, "map_contradicts", panel))
        if len(self.belief.witnesses) >= 2 and not self.mount_contradicts and self.belief.filter.contradicts_mount:
            self.mount_contradicts = True
            self._tell(Event(look.t_ns, "mount_contradicts", panel))

    def report(self) -> tuple[Floats, Floats]:
        """The pose and its covariance, which spans both beliefs."""
        own = self.belief.filter
        if self.rival is None:
            return own.pose, own.covariance
        other = self.rival.belief.filter
        apart = _apart(other, own)
        return own.pose, own.covariance + other.covariance + np.outer(apart, apart)

    def _accepted(self, look: Look, chi2: float) -> None:
        """The belief agrees: does the rival?"""
        rival = self.rival
        if rival is None:
            return
        innovation = rival.belief.filter.compare(look)
        agrees = rival.belief.hear(look, innovation)
        rival.neither = 0
        if look.panel == rival.founder:
            if not agrees or chi2 < innovation.chi2 + MIRROR_LEAD:
                self.rival = None  # it was one bad look
        elif not agrees:
            rival.against[look.panel] = rival.against.get(look.panel, 0) + 1
            self._accuse(look.t_ns, rival)

    def _accuse(self, now_ns: int, rival: Rival) -> None:
        """Names the rival's founder, if two others have agreed with the belief, and not with the rival, since."""
        speak = [p for p, looks in rival.against.items() if looks >= REPEATED and p not in rival.belief.witnesses]
        witnesses = [self.belief.witnesses[p] for p in speak if p in self.belief.witnesses]
        if len(witnesses) < 2 or rival.looks < REPEATED:
            return
        # Nor do two agree, if one of them might hang as far elsewhere, and the state before it would not have told.
        if any(before is not None and self._is_apart(rival.belief.filter, before) for before in witnesses):
            self.belief.witnesses.pop(rival.founder, None)
            self.moved[rival.founder], self.rival = 0, None
            self._tell(Event(now_ns, "panel_moved", rival.founder))

    def _is_apart(self, other: Filter, covariance: Floats) -> bool:
        """Tells whether another pose is none that the belief's would allow, were its covariance this one."""
        apart = _apart(other, self.belief.filter)
        return float(apart @ np.linalg.solve(covariance + other.covariance, apart)) > GATE[POSE]

    def _refused(self, look: Look) -> None:
        """The belief disagrees: is there a rival that does not?"""
        rival = self.rival
        if rival is None or not rival.belief.hear(look, rival.belief.filter.compare(look)):
            if rival is not None:
                rival.neither += 1
            if rival is None or rival.neither >= REPEATED:
                self._begin(look)
            return
        rival.neither, rival.looks = 0, rival.looks + 1
        if look.panel == rival.founder:
            settled = rival.agreed_before and look.t_ns - rival.begun_ns >= SETTLES_NS and not rival.against
        else:
            settled = look.panel in rival.belief.witnesses
        if settled and rival.looks >= REPEATED:
            if self._is_apart(rival.belief.filter, self.belief.filter.covariance):
                self.relocalisations += 1
                self._tell(Event(look.t_ns, "relocalised", look.panel))
            self.belief, self.rival, self.used_ns, self.way_m = rival.belief, None, look.t_ns, 0.0

    def _begin(self, look: Look) -> None:
        """Begins a rival at a look that leaves no choice, with what is known of odometry; of panels, if two agreed."""
        if look.alternate is None:
            own, agreed = self.belief, look.panel in self.belief.witnesses
            belief = Belief((own.filter if agreed and len(own.witnesses) >= 2 else self.empty).copy())
            belief.filter.move_like(own.filter)
            belief.start(look)
            self.rival = Rival(belief, look.panel, look.t_ns, agreed)

    def _pardon(self, panel: int, innovation: Innovation) -> None:
        """Listens again to a panel that hangs right again."""
        agrees = innovation.chi2 <= GATE[len(innovation.error)] and evidence(innovation) <= AGREES
        self.moved[panel] = self.moved[panel] + 1 if agrees else 0
        if self.moved[panel] >= 2 * REPEATED:
            del self.moved[panel]

    def _tell(self, event: Event) -> None:
        self.events = (*self.events, event)[-16:]


def evidence(innovation: Innovation, error: float = 1.0) -> float:
    """χ² by which a look is likelier of a panel that hangs elsewhere than of one that hangs right: 2·ln of their ratio.

    Both are normal, the first is wider by MISPLACED. With `error` 0: of a look that shows just what was predicted.
    """
    elsewhere = innovation.covariance + MISPLACED * np.eye(len(innovation.error))
    wider = float(innovation.error @ np.linalg.solve(elsewhere, innovation.error))
    ratio = np.linalg.det(innovation.covariance) / np.linalg.det(elsewhere)
    return error * (innovation.chi2 - wider) + math.log(ratio)


def _apart(one: Filter, other: Filter) -> Floats:
    error = one.pose - other.pose
    error[YAW] = wrapped(error[YAW])
    return error
