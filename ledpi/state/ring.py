"""The inputs of the last seconds in the order of their own times, whatever order they arrived in.

A look that was exposed 60 ms ago is put in its place, and what came after it is done once more from the snapshot before
it. So the state depends on what arrived, and not on when: equal to the bit, within what the ring keeps.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from copy import copy
from operator import attrgetter

from ledpi.core.records import Rejected
from ledpi.state.belief import Judge
from ledpi.state.motion import SILENT_NS, Step, are_linked, between, leaps, step_between
from ledpi.state.records import IN_FUTURE, LEAP, TOO_OLD, Look, Odometry, OdometryNoise

KEPT_NS, FORGOTTEN_AT_ONCE_NS = 2_000_000_000, 500_000_000
SPAN_NS = 50_000_000  # between snapshots; of a panel's looks in each span the first is used: more say nothing new
EARLY_NS = 20_000_000  # by which two clocks may differ

Input = Odometry | Look
_time = attrgetter("t_ns")


class Head:
    """The state after some of the inputs.

    Messages of odometry add up until a span ends or a panel is seen; within it the way is as good as an arc. So `judge`
    holds at `t_ns`, and `last` may be later.
    """

    def __init__(self, judge: Judge, noise: OdometryNoise) -> None:
        self.judge, self._noise = judge, noise
        self.t_ns: int | None = None
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
            self.judge.lift()


class Ring:
    """The inputs, the snapshots, and the state after all of them."""

    def __init__(self, head: Head) -> None:
        self.head = head
        self._inputs: list[Input] = []
        self._keys: list[tuple[int, int]] = []  # of each: its time; -1 of odometry, else the panel
        self._odometry: list[Odometry] = []
        self._first_ns: dict[tuple[int, int], int] = {}  # of a span's looks at a panel
        self._snapshots: list[tuple[int, Head]] = []  # each before the input of that number

    def add(self, what: Input, now_ns: int) -> Rejected | None:
        """Takes an input that arrives at `now_ns`, and does again what came after it. Returns why it is not used."""
        if what.t_ns > now_ns + EARLY_NS:
            return IN_FUTURE
        if self._inputs and what.t_ns < self._inputs[-1].t_ns - KEPT_NS:
            return TOO_OLD
        if isinstance(what, Look):
            span = what.t_ns // SPAN_NS, what.panel
            if self._first_ns.get(span, what.t_ns + 1) <= what.t_ns:
                return None
            self._first_ns[span] = what.t_ns
        key = (what.t_ns, what.panel if isinstance(what, Look) else -1)
        at = bisect_left(self._keys, key)
        if at < len(self._keys) and self._keys[at] == key:
            return None
        changed, rejected = at, None
        if isinstance(what, Odometry):
            k = bisect_left(self._odometry, what.t_ns, key=_time)
            previous = self._odometry[k - 1] if k else what
            self._odometry.insert(k, what)
            if what.t_ns - previous.t_ns <= SILENT_NS:
                changed = min(at, bisect_right(self._keys, (previous.t_ns, -1)))  # what is between hangs on both
            rejected = LEAP if leaps(previous, what) and not what.restarted else None
        self._inputs.insert(at, what)
        self._keys.insert(at, key)
        self._run_from(changed)
        self._forget()
        return rejected

    def _run_from(self, changed: int) -> None:
        """Takes all inputs from one on, after what the last snapshot before it has taken."""
        done = len(self._inputs) - 1
        if changed < done:
            while self._snapshots[-1][0] > changed:
                self._snapshots.pop()
            done, snapshot = self._snapshots[-1]
            self.head = snapshot.copy()
        for at in range(done, len(self._inputs)):
            t_ns = self._inputs[at].t_ns
            if not self._snapshots or t_ns - self._inputs[self._snapshots[-1][0]].t_ns >= SPAN_NS:
                self._snapshots.append((at, self.head.copy()))
            k = bisect_left(self._odometry, t_ns, key=_time)
            self.head.take(self._inputs[at], self._odometry[k] if k < len(self._odometry) else None)

    def _forget(self) -> None:
        """Drops what nothing can come before any more, from time to time."""
        oldest_ns = self._inputs[-1].t_ns - KEPT_NS
        if self._inputs[0].t_ns > oldest_ns - FORGOTTEN_AT_ONCE_NS:
            return
        kept = max(k for k, (at, _) in enumerate(self._snapshots) if self._inputs[at].t_ns <= oldest_ns)
        cut = self._snapshots[kept][0]
        del self._inputs[:cut], self._keys[:cut], self._odometry[: bisect_left(self._odometry, oldest_ns, key=_time)]
        self._snapshots = [(at - cut, head) for at, head in self._snapshots[kept:]]
        self._first_ns = {span: t_ns for span, t_ns in self._first_ns.items() if t_ns >= oldest_ns}
