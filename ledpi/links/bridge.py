"""A bridge: one thread follows the tap, another serves the target. The daemon waits for neither.

    tap ──▶ mailbox (the newest frame) ──▶ target

What the target does not take at once is dropped and counted. A target that is lost is opened again, and the daemon too.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from ledpi.config.outputs import Kind, OutputSettings
from ledpi.core.errors import LedpiError, TapError, TransientError, install_command
from ledpi.daemon.reporting import event
from ledpi.daemon.tap.client import Client, connect
from ledpi.links.target import BridgeError, Line, Target, TargetLostError
from ledpi.wire.mavlink import load_dialect

# By kind: the module and class, and the extra of pyproject.toml that brings what it imports.
TARGETS: dict[Kind, tuple[str, str, str | None]] = {
    "stdout": ("sockets", "StdoutTarget", None),
    "udp": ("sockets", "UdpTarget", None),
    "tcp": ("sockets", "TcpTarget", None),
    "mqtt": ("mqtt", "MqttTarget", "mqtt"),
    "nt": ("nt", "NtTarget", "nt"),
    "zenoh": ("zenoh_ros", "ZenohTarget", "zenoh"),
}


def target_class(name: str, settings: OutputSettings) -> Callable[[OutputSettings], Target]:
    """Returns what makes a target of these settings. Raises BridgeError, ConfigError where its packages are missing."""
    kind = settings.kind
    module, target, extra = TARGETS[kind]
    if settings.format == "mavlink":
        load_dialect(f"outputs.{name}.format")
    try:
        made: Callable[[OutputSettings], Target] = getattr(import_module(f"ledpi.links.{module}"), target)
    except ImportError as error:
        said = f"outputs.{name}: kind {kind} needs the package {error.name}"
        raise BridgeError(f"{said}: {install_command(extra or kind)}") from None
    return made


def open_target(name: str, settings: OutputSettings) -> Target:
    """The target, not yet connected. Raises LedpiError where its packages are missing, or its files cannot be read."""
    return target_class(name, settings)(settings)


TICK_S = 0.1
RETRY_DAEMON_S = 0.3
BACKOFF_FIRST_S, BACKOFF_LAST_S = 0.1, 0.5
REPORT_S = 60.0
ALL_STALE_NS = 5_000_000_000  # so long nothing but old frames: this computer is too slow
_log = logging.getLogger("ledpi.bridge")


class Mail(NamedTuple):
    """The lines that have come since the last look."""

    setup: Line | None = None  # a `hello`
    frame: Line | None = None  # a `decoded`
    health: Line | None = None
    robot: Line | None = None  # a `robot_state`
    state: str | None = None  # of the daemon, where it has changed


class Mailbox:
    """Any thread may use it."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._mail = Mail()
        self.replaced = 0  # frames by newer ones, before anybody looked

    def put(self, mail: Mail) -> None:
        """Replaces what of the same kind still waits. Never waits."""
        with self._changed:
            old = self._mail
            self.replaced += old.frame is not None and mail.frame is not None
            newest: Iterator[Any] = (new or waiting for new, waiting in zip(mail, old, strict=True))
            self._mail = Mail(*newest)
            self._changed.notify()

    def take(self, timeout_s: float) -> Mail:
        """All that waits, as soon as something does; nothing after `timeout_s`."""
        with self._changed:
            self._changed.wait_for(lambda: self._mail != Mail(), timeout_s)
            mail, self._mail = self._mail, Mail()
            return mail


@dataclass(slots=True)
class Counters:
    """Frames since the start, and what became of them."""

    sent: int = 0
    missed: int = 0  # the daemon had newer ones before this process read them
    replaced: int = 0  # by a newer one, before the target took it
    stale: int = 0  # older than allowed when its turn came
    refused: int = 0  # the target had no room, or the frame does not fit it
    absent: int = 0  # there was no target
    opened: int = 0  # times that the target was reached


class Bridge:
    """Runs until `stop`, which any thread or signal handler may call."""

    def __init__(
        self, name: str, target: Target, socket_path: str, max_age_ms: float, only_of: Path | None = None
    ) -> None:
        """`only_of`: the configuration whose daemon it must be, where the socket may be another's."""
        self._only_of = only_of
        self.counters = Counters()
        self._name, self._target, self._socket_path = name, target, socket_path
        self._max_age_ns = round(max_age_ms * 1e6)
        self._mailbox = Mailbox()
        self._setup: Line | None = None
        self._state = "no_daemon"
        self._is_open = False
        self._stopping = False
        self._said: str | None = None  # of the target's absence, the last time
        self._stale_since_ns: int | None = None  # when the first was of those with no newer one between; 0: it was told
        self._unfit: str | None = None  # of a frame that could not be sent, the last time
        self._retry_s, self._backoff_s = 0.0, BACKOFF_FIRST_S
        self._tap: Client | None = None
        self._reader = threading.Thread(target=self._follow, name="tap", daemon=True)

    def stop(self) -> None:
        """Takes no lock."""
        self._stopping = True

    def run(self) -> None:
        """Serves the target. Raises BridgeError where it never was reached and a person has to act."""
        self._reader.start()
        reported_s = time.monotonic()
        try:
            while not self._stopping:
                self._serve(self._mailbox.take(TICK_S))
                if time.monotonic() - reported_s >= REPORT_S:
                    reported_s = time.monotonic()
                    self._report()
        finally:
            self._target.close()
            if (tap := self._tap) is not None:
                tap.close()
            self._report()

    def _follow(self) -> None:
        """Puts what the daemon says into the mailbox, and says when it is gone."""
        while not self._stopping:
            try:
                self._tap = tap = connect(self._socket_path)
            except TapError:
                time.sleep(RETRY_DAEMON_S)
                continue
            dropped = 0  # by this daemon's tap, for us
            is_other = False
            for line in tap.lines(reconnect=True):
                if line["type"] == "hello":
                    is_other = self._is_others(line)
                if is_other:
                    self._mailbox.put(Mail(state="no_daemon"))
                    continue
                newly, dropped = line.get("dropped", dropped) - dropped, line.get("dropped", dropped)
                self.counters.missed += max(0, newly)  # another daemon begins at 0
                self._mailbox.put(_mail_of(line))

    def _is_others(self, hello: Line) -> bool:
        """Tells whether the daemon has another configuration: its poses are another camera's."""
        path = hello.get("config_path")
        if self._only_of is None or path is None or Path(path).resolve() == self._only_of.resolve():
            return False
        said = f"{self._socket_path} is of the daemon with {path}, not {self._only_of}; give each a tap.socket"
        _log.warning(event("other_daemon", output=self._name, error=said, then="nothing of it is sent"))
        return True

    def _serve(self, mail: Mail) -> None:
        self._setup = mail.setup or self._setup
        self._state = mail.state or self._state
        self.counters.replaced = self._mailbox.replaced
        if not self._is_open and not self._open():
            self.counters.absent += mail.frame is not None
            return
        try:
            if mail.setup is not None:
                self._stale_since_ns = None
                self._target.tell_setup(mail.setup)
            if mail.state is not None or mail.health is not None:
                self._target.tell_state(self._state, mail.health)
            if mail.frame is not None:
                self._send(mail.frame)
            if mail.robot is not None and self._is_new(mail.robot.get("t_ns"), now_ns := time.monotonic_ns()):
                self._takes(self._target.send_robot, mail.robot, now_ns)
            self._target.tick()
        except TargetLostError as error:
            self._lose(error)

    def _send(self, frame: Line) -> None:
        now_ns = time.monotonic_ns()
        if not self._is_new(frame.get("exposed_ns"), now_ns):
            self.counters.stale += 1
            self._note_stale(now_ns)
            return
        self._stale_since_ns = None
        if self._takes(self._target.send, frame, now_ns):
            self.counters.sent += 1
        else:
            self.counters.refused += 1

    def _is_new(self, t_ns: object, now_ns: int) -> bool:
        return isinstance(t_ns, int) and now_ns - t_ns <= self._max_age_ns

    def _note_stale(self, now_ns: int) -> None:
        """Says it once of each time in which nothing was new enough."""
        if self._stale_since_ns is None:
            self._stale_since_ns = now_ns
        elif self._stale_since_ns and now_ns - self._stale_since_ns >= ALL_STALE_NS:
            self._stale_since_ns = 0
            said = f"for 5 s every frame was older than {self._max_age_ns / 1e6:g} ms when its turn came"
            then = f"end other programs, take a smaller picture, or a larger outputs.{self._name}.max_age_ms"
            _log.warning(event("all_stale", output=self._name, error=said, then=then))

    def _takes(self, send: Callable[[Line, int], bool | None], line: Line, now_ns: int) -> bool:
        """Tells whether the target has it now. A line that fits no message of it is refused, and stops nothing."""
        try:
            return send(line, now_ns) is not False
        except TransientError:
            raise
        except (LedpiError, LookupError, TypeError, ValueError, AttributeError) as error:
            if str(error) != self._unfit:
                self._unfit = str(error)
                _log.warning(event("frame_refused", output=self._name, error=f"{type(error).__name__}: {error}"))
            return False

    def _open(self) -> bool:
        if time.monotonic() < self._retry_s:
            return False
        try:
            self._target.open()
            self._is_open = True
            if self._setup is not None:
                self._target.tell_setup(self._setup)
            self._target.tell_state(self._state, None)
        except TargetLostError as error:
            self._lose(error)
            return False
        except BridgeError as error:
            if self.counters.opened == 0:
                raise
            self._lose(error)  # it was well once, as a certificate before its end: the other side may put it right
            return False
        self._said, self._backoff_s, self._stale_since_ns = None, BACKOFF_FIRST_S, None
        self.counters.opened += 1
        _log.info(event("target_open", output=self._name))
        return False  # what has waited meanwhile is not new any more

    def _lose(self, error: TargetLostError | BridgeError) -> None:
        """Notes it, each reason once."""
        if self._is_open:
            self._target.close()
        if str(error) != self._said:
            self._said = str(error)
            _log.warning(event("target_lost", output=self._name, error=error, then="retrying"))
        self._is_open = False
        self._retry_s = time.monotonic() + self._backoff_s
        self._backoff_s = min(2 * self._backoff_s, BACKOFF_LAST_S)

    def _report(self) -> None:
        _log.info(event("bridge", output=self._name, **asdict(self.counters)))


def _mail_of(line: Line) -> Mail:
    kind = line["type"]
    if kind == "hello":
        return Mail(setup=line, state="running")
    if kind == "decoded":
        return Mail(frame=line)
    if kind == "health":
        return Mail(health=line, state=str(line.get("state")))
    if kind == "robot_state":
        return Mail(robot=line)
    return Mail(state="no_daemon") if kind == "lost" else Mail()
