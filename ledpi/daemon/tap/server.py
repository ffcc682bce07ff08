"""The tap's server: a thread that tells its followers what the daemon decodes, and answers what they ask.

The decode thread hands frames over and goes on at once. What it does for the tap: it looks whether somebody follows,
appends to a queue that drops its oldest, and copies the picture of a frame for which somebody asked.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from statistics import median
from typing import Any

from ledpi.core.errors import one_line
from ledpi.core.records import Decoded, Frame
from ledpi.daemon.tap import messages
from ledpi.daemon.tap.commands import Command, Commands
from ledpi.daemon.tap.crowd import Bell, Crowd, Listening
from ledpi.daemon.tap.follower import Follower, Kind
from ledpi.daemon.tap.messages import Faults, Setup, Shown
from ledpi.daemon.tap.protocol import AT_ONCE, Do, Extra, Request, error, write_line
from ledpi.pipeline.trace import Trace

# At most so often: each picture costs the decode thread a copy, and with its evidence some tracing.
PICTURE_EVERY_S = 0.05
# That may wait for clients before another picture is made: who does not read its own keeps others waiting, not memory.
MOST_WAITING_BYTES = 1 << 23
# Between two turns, in each of which a client may ask one thing.
PACE_S = 0.002
# Of a processor's time, that clients may take by what they ask, connect and read: however many flood the tap, the
# decoder needs the interpreter. After a turn for them, or with a picture, frames and health are sent and what waits
# still, until so much has passed.
CLIENTS_SHARE = 0.05
# Frames that are passed over for one of which the whole picture was searched, where somebody wants to know what was
# rejected: a stream searches in every third.
MOST_PASSED = 3
_QUEUE = 4  # frames between the decode thread and this one
_TURN_S = 1.0
_JOIN_S = 0.5
_LAST_S = 0.1  # for commands that the daemon's end has ended

_log = logging.getLogger("ledpi")


class Tap:
    """One socket, for one daemon after the other. But for `start` and `close` all may be called from any thread.

    Whatever happens to it, the daemon goes on.
    """

    def __init__(self, path: Path) -> None:
        """Listens at once; clients hear of something once it is started and a daemon begins. Raises ConfigError."""
        self.path = path
        self._listening = Listening(path)
        self._bell = Bell()
        self._crowd = Crowd(self._listening, self._bell)
        self._commands = Commands(self._bell.ring)
        self._faults = Faults()
        self._closing = self._followed = False
        self._setup: Setup | None = None
        self._health: dict[str, Any] | None = None
        self._state: dict[str, Any] | None = None
        self._news: deque[Shown] = deque(maxlen=_QUEUE)
        self._number = self._last = 0  # of frames: shown, and passed on
        self._latency_ms: list[float] = []  # since the last line of health
        self._asked: list[tuple[Follower, Request]] = []  # for pictures
        self._wanted: frozenset[Extra] | None = None  # what the next picture comes with; None: there is to be none
        self._passed = 0  # frames since then that were not searched
        self._pictured_s = self._turned_s = self._heard_from_s = 0.0
        self._thread = threading.Thread(target=self._run, name="tap", daemon=True)

    def start(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def begin(self, setup: Setup) -> None:
        """A daemon begins: all followers get its hello."""
        self._setup = setup
        self._bell.ring()

    def offer(self, do: Do, command: Command | None) -> None:
        """Sets what is done, in a thread of its own, when one who may says `do`; None: nothing, and it is told so."""
        self._commands.offer(do, command)

    @property
    def is_there(self) -> bool:
        """Tells whether clients find its socket."""
        return self._listening.is_there

    @property
    def is_followed(self) -> bool:
        """Tells whether anybody reads."""
        return self._followed

    @property
    def waiting_bytes(self) -> int:
        """Counts all that waits for clients."""
        return self._crowd.waiting_bytes

    def trace(self) -> Trace | None:
        """For the decoder to fill in, where somebody wants to know what the next frame went through."""
        return Trace() if self._wanted else None

    def show(self, frame: Frame, decoded: Decoded, trace: Trace | None = None) -> None:
        """A whole frame, decoded just now and with its picture still there. Never waits.

        `trace`: as `trace()` gave it, filled in.
        """
        if not self._followed:
            return
        pixels = None
        if self._is_wanted(trace):
            self._wanted, self._passed, pixels = None, 0, frame.pixels.copy()
        self._number += 1
        self._news.append(
            Shown(
                number=self._number,
                frame=frame.drop_picture(),
                decoded=decoded,
                done_ns=time.monotonic_ns(),
                rows=frame.pixels.shape[0],
                pixels=pixels,
                trace=None if pixels is None else trace,
            )
        )
        self._bell.ring()

    def _is_wanted(self, trace: Trace | None) -> bool:
        """Tells whether a frame that left this trace answers those who wait for a picture."""
        wanted = self._wanted
        if wanted is None or (wanted and trace is None):
            return False
        if trace is None or trace.searched or "rejected" not in wanted:
            return True
        self._passed += 1
        return self._passed > MOST_PASSED

    def tell(self, health: Mapping[str, Any]) -> None:
        """The state of things; once a second."""
        self._health = dict(health)
        self._bell.ring()

    def tell_state(self, state: dict[str, Any]) -> None:
        """The robot's; many times a second."""
        if self._followed:
            self._state = state
            self._bell.ring()

    def close(self) -> None:
        """Ends the thread and takes the socket away. Safe to call twice."""
        self._closing = True
        if self._thread.ident is not None:
            self._bell.ring()
            self._thread.join(_JOIN_S)
        self._faults.close()
        self._listening.close()

    def _run(self) -> None:
        try:
            while not self._closing:
                self._turn()
            self._commands.wait(_LAST_S)
            self._answer_commands()
            self._crowd.send()  # what ended with the daemon: each hears how
        except Exception as fault:  # ours, and no reason for the daemon to end
            _log.warning("tap_ended error=%s", one_line(f"{type(fault).__name__}: {fault}"))
        self._followed, self._wanted = False, None
        self._crowd.close()
        self._listening.close()

    def _turn(self) -> None:
        """Waits for something to do, and does it."""
        time.sleep(max(0.0, min(PACE_S, self._turned_s + PACE_S - time.monotonic())))
        pause_s, worked_s = self._heard_from_s - time.monotonic(), time.thread_time()
        heard, pictured_s = pause_s <= 0.0, self._pictured_s
        if not heard:
            self._crowd.wait_for_bell(pause_s)
        else:
            self._crowd.wait(PICTURE_EVERY_S if self._asked and self._wanted is None else _TURN_S)
            for follower, request in self._crowd.requests():
                self._take_up(follower, request)
        self._turned_s = time.monotonic()
        self._answer_commands()
        self._greet()
        self._pass_on()
        self._crowd.send()
        self._asked = [(follower, request) for follower, request in self._asked if not follower.is_gone]
        if heard:
            self._ask_for_picture()
        if heard or self._pictured_s > pictured_s:
            since_s = max(time.monotonic(), self._heard_from_s)
            self._heard_from_s = since_s + (time.thread_time() - worked_s) / CLIENTS_SHARE
        self._followed = len(self._crowd) > 0

    def _answer_commands(self) -> None:
        for follower, answer in self._commands.done():
            follower.open_answers -= 1
            raw = answer.pop("raw", None)
            follower.answer(write_line(answer | ({} if raw is None else {"bytes": len(raw)})), raw)

    def _greet(self) -> None:
        """Says hello to those who have not heard that of this daemon."""
        setup = self._setup
        for follower in self._crowd:
            if follower.greeted_by is not setup and setup is not None and not follower.ending:
                follower.answer(write_line(messages.hello(setup, self._commands.offered(follower))))
                follower.greeted_by = setup

    def _take_up(self, follower: Follower, request: Request) -> None:
        answer: dict[str, Any] | None
        if request.do == "config":
            answer = self._config(request)
        elif request.do == "picture":
            self._asked.append((follower, request))
            answer = None
        elif request.do == "take" and self.waiting_bytes > MOST_WAITING_BYTES:
            answer = error("take: clients have not read what they asked for; ask again later", request.id)
        else:
            answer = self._commands.begin(follower, request)
        if answer is None:
            follower.open_answers += 1
        elif request.id is not None or request.do not in AT_ONCE or answer["type"] == "error":
            follower.answer(write_line(answer))

    def _config(self, request: Request) -> dict[str, Any]:
        if self._setup is None:
            return error("config: the daemon is starting; ask again later", request.id)
        return {"type": "config", "id": request.id, "values": self._setup.values, "from": self._setup.origins}

    def _pass_on(self) -> None:
        """Passes on what the daemon has shown and told since the last turn, the newest frame only."""
        newest = None
        while self._news:
            newest = self._news.popleft()
            self._latency_ms.append((newest.done_ns - messages.ready_ns(newest)) * 1e-6)
            if newest.pixels is not None:
                self._answer_pictures(newest)
        if newest is not None:
            missed, self._last = newest.number - self._last - 1, newest.number
            for follower in self._crowd:
                follower.dropped += missed
            self._show_all("frame", messages.decoded(newest))
        state, self._state = self._state, None
        if state is not None:
            self._show_all("state", state)
        health, self._health = self._health, None
        if health is not None:
            taken, self._latency_ms = self._latency_ms, []
            latency = {"median": round(median(taken), 3), "worst": round(max(taken), 3)} if taken else None
            path = None if self._setup is None else self._setup.config_path
            own = {"latency_ms": latency, "faults": self._faults.kept(), "config_path": path}
            self._show_all("health", {"type": "health", **health, **own})

    def _show_all(self, kind: Kind, values: dict[str, Any]) -> None:
        line = write_line(values)
        for follower in self._crowd:
            follower.show(kind, line)

    def _answer_pictures(self, shown: Shown) -> None:
        """Sends this frame's to those who have read their last one."""
        setup, self._pictured_s = self._setup, time.monotonic()
        assert setup is not None, "a daemon begins before it shows anything"
        left = []
        for follower, request in self._asked:
            if follower.is_gone:
                continue
            if follower.is_blocked or (request.extras and shown.trace is None):
                left.append((follower, request))
                continue
            follower.open_answers -= 1
            follower.answer(write_line(messages.picture(shown, request, setup.panels)), shown.pixels)
        self._asked = left

    def _ask_for_picture(self) -> None:
        """Asks for the next frame's, where somebody waits for one and it is time."""
        if not self._asked or self._wanted is not None or time.monotonic() - self._pictured_s < PICTURE_EVERY_S:
            return
        if self.waiting_bytes <= MOST_WAITING_BYTES:
            ready = [request for follower, request in self._asked if not follower.is_blocked]
            if ready:
                self._wanted = frozenset().union(*(request.extras for request in ready))
