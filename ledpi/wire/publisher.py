"""The publisher thread: takes what was decoded and puts it on the serial line, whatever the line does."""

from __future__ import annotations

import json
import logging
import threading
import time
from collections import deque
from collections.abc import Callable

from ledpi.config.settings import SerialSettings
from ledpi.core.errors import WireError
from ledpi.core.records import Decoded
from ledpi.wire.codec import DELIMITER, encode, number_after
from ledpi.wire.line import Ear, Others, SerialLine, listening
from ledpi.wire.mavlink import HEARTBEAT_PERIOD_NS, Mavlink
from ledpi.wire.message import FixMessage, MarkerMessage, Message, StatusMessage, SyncAnswer
from ledpi.wire.outbox import STATUS_PERIOD_NS, Outbox, PublisherCounters
from ledpi.wire.state_message import StateMessage, TimeAsk

BACKOFF_FIRST_S = 0.1
BACKOFF_LAST_S = 0.5  # a port that is back is found within this time
GOODBYE_S = 0.4  # for the last status to leave; the whole daemon must end within 1 s
JOIN_S = 1.0
RECENT = 15  # packets that say how long it takes to make one

_SENT: tuple[type[Message], ...] = (FixMessage, StatusMessage, MarkerMessage, StateMessage, TimeAsk, SyncAnswer)

_log = logging.getLogger("ledpi")


class Publisher:
    """Writes poses and a status heartbeat to the motor controller, if there is a port. Only `stop` waits for it."""

    def __init__(
        self, settings: SerialSettings, mavlink: Mavlink | None = None, *, map_resets: int = 0, ear: Ear | None = None
    ) -> None:
        """`mavlink`: speaks that in place of our own protocol. `map_resets`: changes of the map so far.

        `ear`: hears what the controller says, which is asked for its clock.
        """
        self._settings, self._mavlink, self._ear = settings, mavlink, ear
        self._outbox = _outbox(settings, mavlink, map_resets, ear)
        self._wake = threading.Condition()  # guards the outbox and all below; not held while the port is used
        self._stopping = False
        self.failure: BaseException | None = None  # what ended the thread: a bug, as no port's fault does
        self._written: dict[type[Message], int] = dict.fromkeys(_SENT, 0)
        self._cut = self._opened = self._sequence = 0
        self._connected = False
        self._error: str | None = None
        self._making_ns = deque([0], maxlen=RECENT)  # from the clock's reading, which is in the packet, to its writing
        self._others = Others()
        self._lent: SerialLine | None = None  # while the thread waits and the line is free: to whoever publishes
        self._borrowed = False
        self._lost: WireError | OSError | None = None  # what the borrower met
        self._thread = threading.Thread(target=self._run, name="publisher", daemon=True)

    def start(self) -> None:
        """Starts the thread, which opens the port again and again until `stop`; not twice, nor without a port."""
        if self._settings.port is not None and self._thread.ident is None:
            self._thread.start()

    def fits(self, settings: SerialSettings, *, hears: bool) -> bool:
        """Tells whether it speaks to that port, as is asked for there, and hears it or not."""
        mine = self._settings
        same_port = (mine.port, mine.baud, mine.protocol) == (settings.port, settings.baud, settings.protocol)
        return same_port and hears == (self._ear is not None)

    def begin_anew(
        self, settings: SerialSettings, mavlink: Mavlink | None, *, map_resets: int, ear: Ear | None = None
    ) -> None:
        """Goes on with another configuration, that it `fits`, and the port stays open: to open it resets an Arduino.

        Poses that wait are forgotten, and counters begin at 0; the packets' numbers go on.
        """
        with self._wake:
            if mavlink is not None and self._mavlink is not None:
                mavlink.continue_after(self._mavlink)
            self._settings, self._mavlink, self._ear = settings, mavlink, ear
            self._outbox = _outbox(settings, mavlink, map_resets, ear)
            self._written, self._cut = dict.fromkeys(self._written, 0), 0
            self._wake.notify()

    def publish(self, decoded: Decoded) -> None:
        """Hands over a frame's poses; newer ones replace those that still wait. Never waits for the port.

        Where the line is free the first packet is written here and now: waking the thread for it would take longer
        than making it. The thread sends the rest, once the line is free again. Without a port nothing is kept.
        """
        if self._settings.port is None:
            return
        with self._wake:
            self._outbox.put(decoded)
            line, self._lent = self._lent, None
            self._borrowed = line is not None
            if line is None:
                self._wake.notify()
                return
        try:
            self._send_next(line)
        except (WireError, OSError) as error:
            self._lost = error
        finally:
            with self._wake:
                self._borrowed = False
                self._wake.notify()

    def set_state(self, state: StateMessage, t_ns: int) -> None:
        """Hands over where the robot is, at a time of CLOCK_MONOTONIC, in place of an older one. Never waits."""
        if self._settings.port is not None:
            self._hand_over(Outbox.put_state, state, t_ns)

    def set_status(self, status: StatusMessage) -> None:
        """Sets what the heartbeat says from now on; `packets_dropped` is filled in here."""
        self._hand_over(Outbox.set_status, status)

    def _hand_over(self, put: Callable[..., None], *what: object) -> None:
        with self._wake:
            put(self._outbox, *what)
            self._wake.notify()

    def name_others(self) -> None:
        """Tells the journal who else has the port open, once each. From one thread, as often as it likes."""
        if self._connected and self._settings.port is not None:
            self._others.name(self._settings.port)

    def stop(self) -> None:
        """Sends a last status, "stopping", if the port is up, and ends the thread within 1 s."""
        with self._wake:
            self._stopping = True
            self._wake.notify()
        if self._thread.ident is not None:
            self._thread.join(JOIN_S)

    @property
    def counters(self) -> PublisherCounters:
        """All of them, as they are at one moment."""
        with self._wake:
            return PublisherCounters(
                fixes=self._written[FixMessage],
                statuses=self._written[StatusMessage],
                markers=self._written[MarkerMessage],
                states=self._written[StateMessage],
                asks=self._written[TimeAsk],
                replaced=self._outbox.replaced,
                stale=self._outbox.stale,
                refused=self._outbox.refused,
                cut=self._cut,
                opened=self._opened,
                port=self._settings.port,
                connected=self._connected,
                error=self._error,
            )

    def _run(self) -> None:
        try:
            self._serve()
        except BaseException as error:
            self.failure = error

    def _serve(self) -> None:
        """Opens the port, and opens it again, until told to stop."""
        backoff_s = BACKOFF_FIRST_S
        while not self._stopping:
            try:
                line = self._open()
                backoff_s = BACKOFF_FIRST_S
                try:
                    with listening(line, None if self._ear is None and self._mavlink is None else self._hear):
                        self._use(line)
                finally:
                    line.close()
            except (WireError, OSError) as error:  # whatever the system refuses, the port is opened anew
                self._note(connected=False, error=str(error))
                self._pause(backoff_s)
                backoff_s = min(2 * backoff_s, BACKOFF_LAST_S)
        self._note(connected=False, error=self._error)

    def _open(self) -> SerialLine:
        """A delimiter is ahead of each frame: foreign bytes cost a packet at most. MAVLink has none."""
        assert self._settings.port is not None  # else the thread would not run
        ahead = DELIMITER if self._mavlink is None else b""
        return SerialLine(self._settings.port, self._settings.baud, ahead=ahead)

    def _use(self, line: SerialLine) -> None:
        """Sends until told to stop. Raises WireError when the port is lost."""
        with self._wake:
            self._outbox.clear()  # nothing that waited for the port is still true
            self._opened += 1
            ear = self._ear
        if ear is not None:
            ear.opened()
        self._note(connected=True, error=None)
        while not self._stopping:
            busy_ns = line.busy_ns(time.monotonic_ns())
            with self._wake:
                idle_ns = self._outbox.idle_ns(time.monotonic_ns())
                if idle_ns and not self._stopping:
                    self._rest((min(idle_ns, busy_ns) or idle_ns) / 1e9, None if busy_ns else line)
                    continue
            if busy_ns:
                self._pause(busy_ns / 1e9)
            else:
                self._send_next(line)
        self._say_goodbye(line)

    def _hear(self, data: bytes, now_ns: int) -> None:
        ear, mavlink = self._ear, self._mavlink  # other ones, after a reload
        for answer in () if mavlink is None else mavlink.questions.heard(data, now_ns):
            self._hand_over(Outbox.put_answer, answer)
        if ear is not None:
            ear.heard(data, now_ns)

    def _rest(self, seconds: float, free: SerialLine | None) -> None:
        """Waits, `_wake` being held, and lends the line meanwhile if it is `free`. Raises WireError if it was lost."""
        self._lent = free
        self._wake.wait(seconds)
        self._wake.wait_for(lambda: not self._borrowed)
        self._lent = None
        lost, self._lost = self._lost, None
        if lost is not None:
            raise lost

    def _send_next(self, line: SerialLine) -> None:
        with self._wake:
            now_ns = time.monotonic_ns()
            first_byte_ns = line.first_byte_ns(now_ns + sorted(self._making_ns)[len(self._making_ns) // 2])
            message = self._outbox.take(first_byte_ns)
        if message is not None:
            self._send(line, message, now_ns, first_byte_ns)

    def _send(self, line: SerialLine, message: Message, begun_ns: int, first_byte_ns: int) -> bool:
        """Tells whether it is done. If not, it is back in the outbox: the port took nothing, or its age is untrue."""
        frame = self._encode(message, first_byte_ns)
        if frame is None:
            return True
        self._making_ns.append(time.monotonic_ns() - begun_ns)
        whole = line.write(frame, self._outbox.latest_ns(message, first_byte_ns))
        with self._wake:
            if whole is None:
                self._outbox.put_back()
                return False
            if self._mavlink is None:
                self._sequence = number_after(self._sequence)
            else:
                self._mavlink.count_sent()
            if whole:
                self._written[type(message)] += 1
            else:
                self._cut += 1
            ear = self._ear
        if ear is not None and isinstance(message, TimeAsk):
            ear.asked(message.number, first_byte_ns)
        return True

    def _encode(self, message: Message, first_byte_ns: int) -> bytes | None:
        if self._mavlink is None:
            return encode(message, self._sequence)
        try:
            return self._mavlink.encode(message, first_byte_ns)
        except WireError:
            with self._wake:
                self._outbox.refused += 1
            return None

    def _say_goodbye(self, line: SerialLine) -> None:
        deadline_ns = time.monotonic_ns() + round(GOODBYE_S * 1e9)
        with self._wake:
            message = self._outbox.stopping_status()
        is_said = False
        while not is_said and (now_ns := time.monotonic_ns()) + (wait_ns := line.busy_ns(now_ns)) < deadline_ns:
            if wait_ns:
                time.sleep(wait_ns / 1e9)
            else:
                is_said = self._send(line, message, now_ns, line.first_byte_ns(now_ns))
        while not line.is_drained(time.monotonic_ns()) and time.monotonic_ns() < deadline_ns:
            time.sleep(0.001)

    def _pause(self, seconds: float) -> None:
        """Sleeps, unless it is time to stop."""
        with self._wake:
            self._wake.wait_for(lambda: self._stopping, seconds)

    def _note(self, *, connected: bool, error: str | None) -> None:
        with self._wake:
            news = not self._stopping and (connected, error) != (self._connected, self._error)
            self._connected, self._error = connected, error
        if news and connected:
            _log.info("serial_open port=%s", self._settings.port)
        elif news:
            _log.warning("serial_lost error=%s", json.dumps(error, ensure_ascii=False))


def _outbox(settings: SerialSettings, mavlink: Mavlink | None, map_resets: int, ear: Ear | None) -> Outbox:
    period_ns = STATUS_PERIOD_NS if mavlink is None else HEARTBEAT_PERIOD_NS
    asks = ear is not None
    return Outbox(max_age_ms=settings.max_age_ms, status_period_ns=period_ns, map_resets=map_resets, asks=asks)
