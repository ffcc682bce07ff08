"""The thread that knows where the robot is, and says so at a steady rate.

Frames, the controller and programs put in what they have, from any thread; it is taken in the order in which it came.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from ledpi.config.settings import Config
from ledpi.core.errors import WireError
from ledpi.core.records import Decoded, Rejected
from ledpi.daemon.reporting import event
from ledpi.pose.fix import Robot
from ledpi.state.belief import Event
from ledpi.state.estimator import State
from ledpi.state.inputs import Odometry
from ledpi.wire.codec import FROM_CONTROLLER, Receiver
from ledpi.wire.diary import Entry, Frame, Look, line_of, seen
from ledpi.wire.keeper import FAILED, Asked, Heard, Input, Keeper, Told
from ledpi.wire.mavlink import Resets, load_dialect
from ledpi.wire.mavlink_heard import AutopilotReceiver
from ledpi.wire.state_message import U32, OdometryMessage, StateMessage, state_message

MOST_LINES = 10_000  # of the diary that wait for a frame: a camera that is lost for a minute
LOOK_S = 0.05  # inputs wait no longer
# Between two messages of odometry that are used: twice as many as are asked for. A board on USB may send thousands a
# second, and more than the estimator takes: no state would ever be told.
LEAST_US = 5000
DAMAGED = Rejected(stage="line", reason="damaged")
NO_SENSE = Rejected(stage="line", reason="no_sense")
UNKNOWN = Rejected(stage="line", reason="unknown")
TOO_OFTEN = Rejected(stage="state", reason="too_often")
DIARY_FULL = Rejected(stage="state", reason="diary_full")
OUT_OF_RANGE = Rejected(stage="state", reason="out_of_range")

_log = logging.getLogger("ledpi")


class Now(NamedTuple):
    """The state at a time."""

    t_ns: int
    state: State | None
    message: StateMessage


class RobotState:
    """One daemon's. `run` is a loop for a thread of its own, until `stop`."""

    def __init__(
        self,
        config: Config,
        robot: Robot,
        map_resets: int,
        tell: Callable[[Now], None],
        reject: Callable[[Rejected], None],
    ) -> None:
        """`tell` takes each state, `reject` why something tells nothing."""
        self._keeper = Keeper(robot, config.odometry, config.serial.baud)
        self._map_resets, self._tell, self._reject = map_resets, tell, reject
        self._period_ns = round(1e9 / config.state_hz)
        self._mavlink_system = config.serial.mavlink_system if config.serial.protocol == "mavlink" else None
        self._receiver = self._new_receiver()
        self._waiting: deque[tuple[Input, Entry]] = deque(maxlen=MOST_LINES)  # as it is taken, and as the diary has it
        self._used_us: dict[tuple[bool, ...], int] = {}  # the last odometry's time on its clock, by what it tells
        self._diary: deque[str] = deque(maxlen=MOST_LINES)
        self._noted: tuple[Event, ...] = ()
        self._has_failed = False
        self._on_bodies = frozenset(i for places in config.bodies.values() for i in places)  # not in the map
        self._ends = threading.Event()

    def see(self, decoded: Decoded) -> Decoded:
        """Takes a whole frame, that was decoded just now; returns it with what a recording keeps of the time before."""
        if markers := tuple(m for m in decoded.markers if m.detection.id not in self._on_bodies):
            mark = Frame(decoded.seq, time.monotonic_ns(), decoded.host_offset_ns)
            self._waiting.append((seen(markers, decoded.host_offset_ns, mark.now_ns), mark))
        return replace(decoded, diary=tuple(self._diary.popleft() for _ in range(len(self._diary))))

    def tell_odometry(self, odometry: Odometry) -> None:
        """Takes that of a program."""
        if not self._is_too_often(odometry, odometry.t_ns // 1000, odometry.totals):
            self._put(Told(odometry, time.monotonic_ns()))

    def _is_too_often(self, said: Odometry | OdometryMessage, at_us: int, totals: tuple[float | None, ...]) -> bool:
        """Tells whether it can be left out, and counts it: the next one's totals say what it says."""
        tells = (*(total is None for total in totals), said.lifted)
        before_us = self._used_us.get(tells)
        if before_us is not None and (at_us - before_us & U32) < LEAST_US and not (said.restarted or said.slipping):
            self._reject(TOO_OFTEN)
            return True
        self._used_us[tells] = at_us
        return False

    def _put(self, what: Heard | Asked | Told) -> None:
        self._waiting.append((what, what))

    def opened(self) -> None:
        """The port is open, anew."""
        self._receiver = self._new_receiver()

    def _new_receiver(self) -> Receiver | AutopilotReceiver:
        system = self._mavlink_system
        return Receiver(FROM_CONTROLLER) if system is None else AutopilotReceiver(load_dialect(), system)

    def asked(self, number: int, first_byte_ns: int) -> None:
        """A question for the controller's clock has left."""
        self._put(Asked(number, first_byte_ns))

    def heard(self, data: bytes, now_ns: int) -> None:
        """Bytes of the controller have just come."""
        before = self._receiver.counters
        for message in self._receiver.feed(data):
            if isinstance(message, OdometryMessage) and self._is_too_often(message, message.clock_us, message.totals):
                continue
            self._put(Heard(message, now_ns))
        now = self._receiver.counters
        if now.bad != before.bad or now.skipped != before.skipped:
            for _ in range(sum(now.skipped.values()) - sum(before.skipped.values())):
                self._reject(UNKNOWN)
            for reason, count in now.bad.items():
                for _ in range(count - before.bad.get(reason, 0)):
                    self._reject(NO_SENSE if reason == "value" else DAMAGED)

    def run(self) -> None:
        """Takes what comes, and tells the state at its times. Goes on whatever fails: poses are worth more."""
        due_ns = time.monotonic_ns()
        while not self._ends.is_set():
            try:
                self._take()
                now_ns = time.monotonic_ns()
                if now_ns >= due_ns:
                    due_ns = max(due_ns + self._period_ns, now_ns)
                    self._tell_at(now_ns)
            except Exception as error:
                self._count(FAILED, error)
            self._ends.wait(min(LOOK_S, max(0.0, (due_ns - time.monotonic_ns()) / 1e9)))

    def stop(self) -> None:
        """Ends `run` soon."""
        self._ends.set()

    def _note(self, entry: Entry) -> None:
        """Notes it for a recording; of what waits too long for a frame the oldest is lost."""
        if len(self._diary) == MOST_LINES:
            self._reject(DIARY_FULL)
        self._diary.append(line_of(entry))

    def _take(self) -> None:
        while self._waiting:
            what, entry = self._waiting.popleft()
            self._note(entry)
            for rejected in self._keeper.take(what):
                self._count(rejected, self._keeper.failure)

    def _count(self, rejected: Rejected, failure: Exception | None) -> None:
        """Counts it; a failure, which is a mistake of ours, is told once, with where it was."""
        self._reject(rejected)
        if rejected == FAILED and not self._has_failed:
            self._has_failed = True
            _log.warning(event("state_failed", error=repr(failure)), exc_info=failure)

    def _tell_at(self, now_ns: int) -> None:
        found = self._keeper.at(now_ns)
        if found == FAILED:
            self._count(FAILED, self._keeper.failure)
        self._note(Look(now_ns))
        state = None if isinstance(found, Rejected) else found
        t_ns = now_ns if state is None else state.t_ns
        clock_us = self._keeper.clock_us(t_ns)
        try:
            message = state_message(state, clock_us=clock_us, map_resets=self._map_resets)
        except WireError:  # none is told, but it is not silent
            self._reject(OUT_OF_RANGE)
            state, message = None, state_message(None, clock_us=clock_us, map_resets=self._map_resets)
        self._tell(Now(t_ns, state, message))
        if state is not None and state.events != self._noted:
            for each in state.events:
                if each not in self._noted:
                    _log.warning(event(f"state_{each.kind}", panel=each.panel))
            self._noted = state.events


def robot_state_of(
    config: Config, robot: Robot, resets: Resets, tell: Callable[[Now], None], reject: Callable[[Rejected], None]
) -> RobotState | None:
    """The one that this configuration asks for; None: none. Warns where it will never know anything."""
    if not config.state_hz:
        return None
    if robot.panels is None:
        _log.warning("map is not set: there will be no state")
    return RobotState(config, robot, resets.maps, tell, reject)
