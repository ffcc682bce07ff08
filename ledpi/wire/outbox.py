"""The queue for the line: newest wins, nothing too old, the state first. Knows neither clock nor port."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias, TypeVar

from ledpi.core.errors import WireError
from ledpi.core.records import BodyPose, Decoded, MarkerPose, RobotFix
from ledpi.wire.message import (
    FixMessage,
    MarkerMessage,
    Message,
    NoFix,
    State,
    StatusMessage,
    SyncAnswer,
    fix_message,
    marker_message,
)
from ledpi.wire.state_message import U16, StateMessage, TimeAsk

STATUS_PERIOD_NS = 160_000_000  # at least 5 a second are promised; this leaves 40 ms for a busy line
# A status that will be due so soon follows the next pose at once. Sent by itself it could be on the line, for 3.6 ms,
# when the next frame's poses are ready; a camera of 25 fps or more has a pose for it to follow in this time.
STATUS_FOLLOWS_NS = 40_000_000

ASK_PERIOD_NS = 500_000_000  # between two questions for the controller's clock

# By how much the age that a packet claims may be too small: more than the usual packet takes longer than reckoned with.
AGE_SLACK_NS = 1_000_000

_Key: TypeAlias = tuple[int, bool]  # ID, and whether this is the alternate
_Placed: TypeAlias = tuple[MarkerPose | BodyPose, int]  # with its mid-exposure on the host's clock
_M = TypeVar("_M", FixMessage, MarkerMessage)


class Outbox:
    """The newest pose of everything in view, and the status. Not thread-safe: its user holds a lock.

    Times are CLOCK_MONOTONIC, ns. A marker keeps its place in the queue when a newer pose of it comes, so all
    have their turn on a short line.
    """

    def __init__(
        self, *, max_age_ms: float, status_period_ns: int = STATUS_PERIOD_NS, map_resets: int = 0, asks: bool = False
    ) -> None:
        """`asks`: for the controller's clock."""
        self._max_age_ns = round(max_age_ms * 1e6)
        self._status_period_ns = status_period_ns
        self._map_resets = map_resets
        self._fix: tuple[RobotFix, int] | None = None  # with its mid-exposure on the host's clock
        self._markers: dict[_Key, _Placed] = {}
        self._state: tuple[StateMessage, int] | None = None  # with the time at which it holds
        self._state_was_last = False
        self._answer: SyncAnswer | None = None
        self._asks = asks
        self._asked = 0
        self._ask_due_ns = 0
        self._sent_fix_ns: int | None = None  # mid-exposure of the newest fix that went out
        self._undo: Callable[[], None] = lambda: None  # puts back what was taken last
        self._status = StatusMessage(state=State.STARTING, no_fix=NoFix.NOT_RUNNING)
        self._status_due_ns: int | None = None  # None: now
        self._status_waits = False  # a fix has gone ahead of a status that was due
        self.replaced = 0  # by a newer pose, or by the port's return
        self.stale = 0
        self.refused = 0  # not fit to be sent: out of range, or from the future

    def put(self, decoded: Decoded) -> None:
        """Takes the poses of a frame in place of older ones of the same things."""
        for marker in decoded.markers:
            mid_ns = marker.mid_exposure_ns + decoded.host_offset_ns
            self._put_marker((marker.detection.id, False), marker, mid_ns)
            if marker.alternate is not None:
                self._put_marker((marker.detection.id, True), marker, mid_ns)
            elif self._markers.pop((marker.detection.id, True), None) is not None:
                self.replaced += 1
        for body in decoded.bodies:
            self._put_marker((body.id, False), body, body.mid_exposure_ns + decoded.host_offset_ns)
        if decoded.robot is not None:
            self.replaced += self._fix is not None
            self._fix = (decoded.robot, decoded.robot.mid_exposure_ns + decoded.host_offset_ns)

    def _put_marker(self, key: _Key, marker: MarkerPose | BodyPose, mid_ns: int) -> None:
        self.replaced += key in self._markers
        self._markers[key] = (marker, mid_ns)  # a key that is there keeps its place

    def put_state(self, state: StateMessage, t_ns: int) -> None:
        """Takes a state, that holds at a time, in place of an older one."""
        self._state = state, t_ns

    def put_answer(self, answer: SyncAnswer) -> None:
        """Takes an answer of our clock, in place of an older one."""
        self._answer = answer

    def set_status(self, status: StatusMessage) -> None:
        """Sets what the next one says; due at once where it says something new of why there is no fix."""
        if (status.state, status.no_fix) != (self._status.state, self._status.no_fix):
            self._status_due_ns = None
        self._status = status

    def clear(self) -> None:
        """Forgets all poses; a status and a question are due at once."""
        self.replaced += len(self._markers) + (self._fix is not None)
        self._markers.clear()
        self._fix = self._sent_fix_ns = self._state = self._answer = None
        self._ask_due_ns = 0
        self._status_due_ns = None

    def idle_ns(self, now_ns: int) -> int:
        """Returns how long there is nothing to send, if nothing is put in."""
        waiting = self._fix or self._state or self._answer or self._markers
        if waiting or self._status_due_ns is None:
            return 0
        due_ns = min(self._status_due_ns, self._ask_due_ns) if self._asks else self._status_due_ns
        return max(0, due_ns - now_ns)

    def take(self, first_byte_ns: int) -> Message | None:
        """The next message for a frame whose first byte leaves at `first_byte_ns`, or None.

        An answer of our clock goes first. Then the state, the question for the clock, the fix, the status, the markers.
        But after a state another has its turn, and a status that is due waits for one fix at most, or a line too short
        for all of them would never carry it. The first fix, and the first after a time without, is followed by a status
        that says so.
        """
        if self._answer is not None:
            answer, self._answer = self._answer, None
            self._undo = partial(setattr, self, "_answer", answer)
            return answer
        if self._state is not None and not self._state_was_last:
            state = self._take_state(first_byte_ns)
            if state is not None:
                return state
        other = self._take_ask(first_byte_ns) or self._take_other(first_byte_ns)
        self._state_was_last = False
        return other or self._take_state(first_byte_ns)

    def _take_other(self, first_byte_ns: int) -> Message | None:
        status_due = self._status_due_ns is None or first_byte_ns >= self._status_due_ns
        if not (status_due and self._status_waits):
            fix = self._take_fix(first_byte_ns)
            if fix is not None:
                self._status_waits = status_due
                self._let_status_follow(first_byte_ns)
                return fix
        if status_due:
            self._undo = partial(setattr, self, "_status_due_ns", None)
            self._status_waits = False
            self._status_due_ns = first_byte_ns + self._status_period_ns
            return self._status_at(first_byte_ns)
        marker = self._take_marker(first_byte_ns)
        if marker is not None:
            self._let_status_follow(first_byte_ns)
        return marker

    def latest_ns(self, message: Message, first_byte_ns: int) -> int | None:
        """By when a message's first byte must leave, so that its age is true and not too old; None: at any time."""
        if isinstance(message, TimeAsk | SyncAnswer):
            return first_byte_ns + AGE_SLACK_NS
        if isinstance(message, StateMessage) and message.clock_us is None and message.t_ns is not None:
            return message.t_ns + self._max_age_ns  # else its receiver sees how old it is
        if not isinstance(message, MarkerMessage | FixMessage):
            return None
        return first_byte_ns + min(AGE_SLACK_NS, self._max_age_ns - 1000 * message.age_us)

    def put_back(self) -> None:
        """Puts back what was taken last and did not go out: it is the next, unless a newer one has come."""
        self._undo()

    def _put_back_fix(self, fix: tuple[RobotFix, int], sent_before_ns: int | None) -> None:
        self._sent_fix_ns = sent_before_ns
        if self._fix is None:
            self._fix = fix
        else:
            self.replaced += 1

    def _put_back_marker(self, key: _Key, marker: _Placed) -> None:
        waiting = (self._markers.get((key[0], alternate)) for alternate in (False, True))
        if all(other is None or other[1] <= marker[1] for other in waiting):
            self._markers = {key: marker} | self._markers
        else:
            self.replaced += 1

    def _let_status_follow(self, now_ns: int) -> None:
        if self._status_due_ns is not None and now_ns >= self._status_due_ns - STATUS_FOLLOWS_NS:
            self._status_due_ns = None

    def stopping_status(self) -> StatusMessage:
        """The last word."""
        return replace(self._counted(self._status), state=State.STOPPING, no_fix=NoFix.NOT_RUNNING)

    def _take_state(self, first_byte_ns: int) -> StateMessage | None:
        taken, self._state = self._state, None
        if taken is None or first_byte_ns - taken[1] > self._max_age_ns:
            return None
        self._undo, self._state_was_last = partial(self._put_back_state, taken), True
        return taken[0]

    def _put_back_state(self, taken: tuple[StateMessage, int]) -> None:
        self._state, self._state_was_last = self._state or taken, False

    def _take_ask(self, first_byte_ns: int) -> TimeAsk | None:
        if not self._asks or first_byte_ns < self._ask_due_ns:
            return None
        self._undo = partial(setattr, self, "_ask_due_ns", 0)
        self._ask_due_ns, self._asked = first_byte_ns + ASK_PERIOD_NS, (self._asked + 1) & U16
        return TimeAsk(number=self._asked)

    def _take_fix(self, first_byte_ns: int) -> FixMessage | None:
        if self._fix is None:
            return None
        (fix, mid_ns), self._fix = self._fix, None
        self._undo = partial(self._put_back_fix, (fix, mid_ns), self._sent_fix_ns)
        message = self._aged(mid_ns, first_byte_ns, partial(fix_message, fix, map_resets=self._map_resets))
        if message is not None:
            if not self._has_fix(first_byte_ns):
                self._status_due_ns = None
            self._sent_fix_ns = mid_ns
        return message

    def _has_fix(self, now_ns: int) -> bool:
        """Tells whether the receiver has a fix that is not too old."""
        return self._sent_fix_ns is not None and now_ns - self._sent_fix_ns <= self._max_age_ns

    def _take_marker(self, first_byte_ns: int) -> MarkerMessage | None:
        while self._markers:
            key = next(iter(self._markers))
            marker, mid_ns = self._markers.pop(key)
            self._undo = partial(self._put_back_marker, key, (marker, mid_ns))
            build = partial(marker_message, marker, alternate=key[1])
            message = self._aged(mid_ns, first_byte_ns, build)
            if message is not None:
                return message
        return None

    def _aged(self, mid_ns: int, first_byte_ns: int, build: Callable[..., _M]) -> _M | None:
        age_ns = first_byte_ns - mid_ns
        if age_ns > self._max_age_ns:
            self.stale += 1
            return None
        try:
            return build(age_us=age_ns // 1000)  # a negative age is a WireError as well: clocks disagree
        except WireError:
            self.refused += 1
            return None

    def _status_at(self, now_ns: int) -> StatusMessage:
        """The status as it was set, but for the fix: there is one while the newest that was sent is not too old."""
        status = self._counted(self._status)
        if status.state is not State.CAMERA_LOST and self._has_fix(now_ns):
            return replace(status, no_fix=NoFix.NONE)
        return replace(status, no_fix=NoFix.STALE) if status.no_fix is NoFix.NONE else status

    def _counted(self, status: StatusMessage) -> StatusMessage:
        return replace(status, packets_dropped=self.replaced + self.stale + self.refused)


@dataclass(frozen=True, slots=True, kw_only=True)
class PublisherCounters:
    """Since the publisher was made. Packets written, poses that were not, and the port's state."""

    fixes: int
    statuses: int
    markers: int
    states: int = 0
    asks: int = 0  # for the controller's clock
    replaced: int  # by a newer pose before there was room on the line
    stale: int  # older than max_age_ms when their turn came
    refused: int  # not fit to be sent: out of range, or from the future
    cut: int  # packets that the port took only in part
    opened: int  # times the port was opened
    port: str | None  # None: there is none, and poses go to the tap alone
    connected: bool
    error: str | None  # why the port is not open, or was last lost

    @property
    def sent(self) -> int:
        """Packets of all kinds."""
        return self.fixes + self.statuses + self.markers + self.states + self.asks

    @property
    def unsent(self) -> int:
        """Poses that never reached the line."""
        return self.replaced + self.stale + self.refused
