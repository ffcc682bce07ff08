"""The state of one robot from all that is seen and said, in the order in which it came. Pure: the same gives the same.

Times are of CLOCK_MONOTONIC.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

from ledpi.config.odometry import OdometrySettings
from ledpi.core.records import MarkerPose, Rejected
from ledpi.pose.fix import Robot
from ledpi.state.estimator import Estimator, State
from ledpi.state.inputs import Odometry
from ledpi.wire.controller import Controller
from ledpi.wire.message import Message


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
