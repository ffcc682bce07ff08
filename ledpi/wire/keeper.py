"""The state of one robot from all that is seen and said, in the order in which it came. Pure: the same gives the same.

A controller's clock is made ours, and its totals are unwrapped. Times are of CLOCK_MONOTONIC.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

from ledpi.config.robot import OdometrySettings
from ledpi.core.records import MarkerPose, Rejected
from ledpi.pose.fix import Robot
from ledpi.state.clock import ControllerClock, Trip
from ledpi.state.estimator import Estimator, State
from ledpi.state.inputs import Odometry
from ledpi.wire.message import Message
from ledpi.wire.numbers import BITS_PER_BYTE, UNITS_PER_SI, wrapped32
from ledpi.wire.state_message import U16, U32, OdometryMessage, TimeAnswer

ASK_BYTES, ANSWER_BYTES = 12, 21  # that a question takes from its first byte on; an answer with a zero ahead
MOST_ASKED = 8  # questions that may wait for an answer: four seconds' worth

UNASKED = Rejected(stage="clock", reason="unasked")


class Controller:
    """One controller, from a moment on: its clock, and the totals that it said last."""

    def __init__(self, baud: int) -> None:
        self._byte_ns = BITS_PER_BYTE * 1_000_000_000 // baud
        self.clock = ControllerClock()
        self._asked_ns: dict[int, int] = {}  # questions that wait
        self._last: tuple[int | None, ...] = (None,) * 3  # totals in their own units, as said
        self._known: list[int | None] = [None] * 3  # the same, as each was said last
        self._totals = [0, 0, 0]  # unwrapped

    def note_asked(self, number: int, first_byte_ns: int) -> None:
        """A question's first byte left."""
        self._asked_ns[number & U16] = first_byte_ns
        for old in list(self._asked_ns)[:-MOST_ASKED]:
            del self._asked_ns[old]

    def take(self, message: Message, now_ns: int) -> Odometry | Rejected | None:
        """Takes a message that has just come: odometry on our clock, or why it tells nothing; None of an answer."""
        if isinstance(message, TimeAnswer):
            return self._answer(message, now_ns)
        return self._odometry(message, now_ns) if isinstance(message, OdometryMessage) else None

    def _answer(self, answer: TimeAnswer, now_ns: int) -> Rejected | None:
        first_byte_ns = self._asked_ns.pop(answer.number, None)
        if first_byte_ns is None:
            return UNASKED
        # A board that is itself the USB device is quicker than the baud rate says: no more than all that it took.
        took_ns = now_ns - first_byte_ns - 1000 * (answer.left_us - answer.arrived_us & U32)
        byte_ns = min(self._byte_ns, max(took_ns, 0) // (ASK_BYTES + ANSWER_BYTES))
        trip = Trip(
            asked_ns=first_byte_ns + ASK_BYTES * byte_ns,
            arrived_us=answer.arrived_us,
            left_us=answer.left_us,
            answered_ns=now_ns - ANSWER_BYTES * byte_ns,
        )
        return self.clock.add(trip)

    def _odometry(self, said: OdometryMessage, now_ns: int) -> Odometry | Rejected:
        self._unwrap(said.totals, said.restarted)
        t_ns = self.clock.to_ns(said.clock_us, now_ns)
        if isinstance(t_ns, Rejected):
            return t_ns
        told = zip(self._last, self._totals, strict=True)
        left_m, right_m, yaw_rad = (None if last is None else total / UNITS_PER_SI for last, total in told)
        return Odometry(
            t_ns=t_ns,
            left_m=left_m,
            right_m=right_m,
            yaw_rad=yaw_rad,
            restarted=said.restarted,
            lifted=said.lifted,
            slipping=said.slipping,
        )

    def _unwrap(self, said: tuple[int | None, ...], restarted: bool) -> None:
        """A message that lacks a total loses no way: the next that has it goes on."""
        for k, now in enumerate(said):
            known = None if restarted else self._known[k]
            if known is not None and now is not None:
                self._totals[k] += wrapped32(now - known)
            self._known[k] = known if now is None else now
        self._last = said


@dataclass(frozen=True, slots=True)
class Seen:
    """Panels of a frame, that was decoded just now."""

    markers: tuple[MarkerPose, ...]
    now_ns: int


@dataclass(frozen=True, slots=True)
class Heard:
    """A message of the controller."""

    message: Message
    now_ns: int


@dataclass(frozen=True, slots=True)
class Asked:
    """A question for the controller's clock, whose first byte left."""

    number: int
    first_byte_ns: int


@dataclass(frozen=True, slots=True)
class Told:
    """Odometry of a program."""

    odometry: Odometry
    now_ns: int


FAILED = Rejected(stage="state", reason="failed")
Input: TypeAlias = Seen | Heard | Asked | Told


class Keeper:
    """The estimator, and the controller's clock. Where the estimator fails it begins anew: poses need no state."""

    def __init__(self, robot: Robot, odometry: OdometrySettings, baud: int) -> None:
        self._new_estimator = partial(Estimator, robot.panels or {}, robot.base_link_from_camera, odometry.noise)
        self._estimator = self._new_estimator()
        self._controller = Controller(baud)
        self.failure: Exception | None = None  # the last

    def take(self, what: Input) -> tuple[Rejected, ...]:
        """Takes what came. Returns why parts of it tell nothing."""
        try:
            return self._take(what)
        except Exception as error:
            return (self._begin_anew(error),)

    def at(self, t_ns: int) -> State | Rejected:
        """As the estimator's."""
        try:
            return self._estimator.at(t_ns)
        except Exception as error:
            return self._begin_anew(error)

    def clock_us(self, t_ns: int) -> int | None:
        """The controller's clock at one of our times; None: not known."""
        return self._controller.clock.to_us(t_ns)

    def _begin_anew(self, error: Exception) -> Rejected:
        self.failure, self._estimator = error, self._new_estimator()
        return FAILED

    def _take(self, what: Input) -> tuple[Rejected, ...]:
        match what:
            case Seen():
                return self._estimator.add_markers(what.markers, what.now_ns)
            case Asked():
                self._controller.note_asked(what.number, what.first_byte_ns)
                return ()
            case Told():
                told: Odometry | Rejected | None = what.odometry
            case Heard():
                told = self._controller.take(what.message, what.now_ns)
        rejected = self._estimator.add_odometry(told, what.now_ns) if isinstance(told, Odometry) else told
        return () if rejected is None else (rejected,)
