"""Knowledge of the daemon for any number of readers: one thread follows the tap, the server's threads look."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from contextlib import suppress
from dataclasses import asdict
from typing import Any

from ledpi.core.errors import TapError
from ledpi.daemon.tap.client import Client, connect
from ledpi.page.lines import check_line
from ledpi.page.metrics import Seen, metrics
from ledpi.page.panels import panels_from_above, robot_from_above, robot_of_state
from ledpi.page.pictures import Pictures
from ledpi.pipeline.diagnosis.reasons import why_no_fix
from ledpi.workshop.doctor.running import checks
from ledpi.workshop.monitor import PanelTable

RETRY_S = 0.3  # between two looks for a daemon at the start
TICK_S = 0.5
SILENT_S = 3.0  # without a line: a daemon says how it is each second
ANSWER_S = 10.0
SAVED_S = 120.0  # seconds of pictures are written as fast as the disk takes them
BEGIN_S = 2.0  # after which a recording is taken to have begun
FORGOTTEN_S = 30.0  # after so long unseen, a panel is no row any more
KEPT_HEALTH = 300  # seconds
KEPT_TRACK = 300  # places of the robot, TRACK_NS apart
TRACK_NS = 200_000_000
OLD_MS, GONE_MS = 500.0, 2000.0  # of the robot's last place: it is old, and shown no longer

_log = logging.getLogger("ledpi.view")


class Hub:
    """Follows one daemon, whichever answers, for ever."""

    def __init__(self, socket_path: str) -> None:
        self._socket_path = socket_path
        self._changed = threading.Condition()
        self._version = 0
        self._tap: Client | None = None
        self._hello: dict[str, Any] | None = None
        self._connected = False
        self._told = "not yet connected to a daemon"
        self._starts = 0  # daemons that were met
        self._heard_s = 0.0
        self._health: dict[str, Any] | None = None
        self._decoded: dict[str, Any] | None = None
        self._placed: dict[str, Any] | None = None  # the last line with a fix
        self._moving: dict[str, Any] | None = None  # the last `robot_state`
        self._panels = PanelTable(FORGOTTEN_S)
        self._seen = Seen()
        self._history: deque[dict[str, Any]] = deque(maxlen=KEPT_HEALTH)
        self._track: deque[tuple[float, float, int]] = deque(maxlen=KEPT_TRACK)
        self._answers: dict[int, dict[str, Any]] = {}
        self._waited_for: set[int] = set()
        self._recording: int | None = None  # the request that has begun it
        self._refused: set[str] = set()  # of the tap's lines; a few, as they name keys
        self._closing = threading.Event()
        self.pictures = Pictures(self._ask_picture)
        self._thread = threading.Thread(target=self._follow, name="tap", daemon=True)

    def start(self) -> None:
        """Begins to look for a daemon."""
        self._thread.start()

    def close(self) -> None:
        """Ends it."""
        self._closing.set()
        if (tap := self._tap) is not None:
            tap.close()
        self._thread.join(2.0)

    # ---- For the server's threads

    def state(self, after: int, timeout_s: float) -> dict[str, Any]:
        """Tells how it is now; waits until something has changed since version `after`, `timeout_s` at most."""
        with self._changed:
            self._changed.wait_for(lambda: self._version != after or self._closing.is_set(), timeout_s)
            now_ns = time.monotonic_ns()
            return {
                "version": self._version,
                "now_ns": now_ns,
                "link": self._link(),
                "daemon": self._daemon(),
                "health": self._health,
                "checks": self._checks(),
                "recording": self._recording is not None,
                "panels": self._panels.rows(now_ns),
                "robot": (robot := self._robot(now_ns)),
                "no_fix": (why := self._no_fix(robot)),
                "no_fix_says": None if why is None else why_no_fix(why),
                "map": None if self._hello is None else panels_from_above(self._hello),
            }

    def metrics(self) -> str:
        """For Prometheus."""
        with self._changed:
            health = self._health if self._link()["state"] == "up" else None
            return metrics(health, self._seen, "" if self._hello is None else self._hello.get("version"))

    def history(self) -> dict[str, Any]:
        """Health of the last minutes, and the robot's track, both oldest first."""
        with self._changed:
            return {"health": list(self._history), "track": [[x, y] for x, y, _ in self._track]}

    def record(self, seconds: float) -> dict[str, Any]:
        """Begins a recording, which runs until it is answered. Raises TapError where that is soon, and an error."""
        return self.ask("record", BEGIN_S, seconds=seconds) or {}

    def record_stop(self) -> dict[str, Any]:
        """Ends it. Raises TapError."""
        self._recording = None
        return self.ask("record_stop") or {}

    def ask(self, do: str, within_s: float = ANSWER_S, **values: Any) -> dict[str, Any] | None:
        """Asks the daemon; None where the answer takes longer. Raises TapError where it is gone, or refuses."""
        tap = self._tap
        if tap is None or not self._connected:
            raise TapError("the daemon is not running")
        with self._changed:
            request_id = tap.send(do, **values)
            self._waited_for.add(request_id)
            self._changed.wait_for(lambda: request_id in self._answers or not self._connected, within_s)
            self._waited_for.discard(request_id)
            answer, gone = self._answers.pop(request_id, None), not self._connected
            if do == "record" and answer is None and not gone:
                self._recording = request_id
        if answer is None and gone:
            raise TapError("the daemon ended before it answered")
        if answer is not None and answer["type"] == "error":
            raise TapError(str(answer.get("error")))
        return answer

    def config(self) -> dict[str, tuple[Any, str]]:
        """The value of each key of the daemon's configuration, and where that is from. Raises TapError."""
        answer = self.ask("config")
        if answer is None:
            raise TapError("the daemon does not answer")
        origins = answer.get("from", {})
        return {key: (value, origins.get(key, "")) for key, value in answer.get("values", {}).items()}

    # ---- For the thread that follows

    def _follow(self) -> None:
        while not self._closing.is_set():
            try:
                self._tap = connect(self._socket_path)
            except TapError as error:
                self._tell(str(error))
                self._closing.wait(RETRY_S)
                continue
            with self._tap:
                for line in self._tap.lines(reconnect=True, tick_s=TICK_S):
                    try:
                        check_line(line)
                    except ValueError as error:
                        self._refuse(line, error)
                        continue
                    self._see(line)

    def _refuse(self, line: dict[str, Any], error: ValueError) -> None:
        """Says so, once of each kind: there may be sixty a second."""
        said = f"a line of the tap, {line['type']}, cannot be used: {error}"
        if said not in self._refused:
            self._refused.add(said)
            _log.warning("%s", said)
        if line["type"] == "hello":
            self._tell(said)

    def _see(self, line: dict[str, Any]) -> None:
        kind = line["type"]
        if kind == "picture":
            if self._hello is not None:
                self.pictures.came(line, self._hello)
            return
        if kind == "robot_state":  # its watchers need not wake: the next frame does that
            self._moving = line
            return
        if kind == "lost":
            self.pictures.lost()
        with self._changed:
            self._take(kind, line)
            self._version += 1
            self._changed.notify_all()

    def _take(self, kind: str, line: dict[str, Any]) -> None:
        if kind != "tick":
            self._heard_s = time.monotonic()
        if kind == "hello":
            if self._hello is not None and any(line.get(key) != self._hello.get(key) for key in _PLACES_IN):
                self._panels, self._placed, self._moving = PanelTable(FORGOTTEN_S), None, None
                self._track.clear()
            self._starts += self._hello is None or not self._connected or line.get("pid") != self._hello.get("pid")
            self._hello, self._connected = line, True
        elif kind == "lost":
            self._connected, self._health, self._recording = False, None, None
            self._told = "the daemon has ended; waiting for it to come back"
        elif kind == "health":
            self._health = line
            self._history.append({"at_ns": time.monotonic_ns()} | {k: line.get(k) for k in _KEPT})
        elif kind == "decoded":
            self._decoded = line
            if line.get("robot") is not None:
                self._placed = line
            self._panels.see(line)
            self._seen.see(line)
            self._keep_track(line)
        elif line.get("id") in self._waited_for:
            self._answers[line["id"]] = line
        elif line.get("id") == self._recording:
            self._recording = None

    def _keep_track(self, decoded: dict[str, Any]) -> None:
        robot, at_ns = decoded.get("robot"), decoded["exposed_ns"]
        if robot is not None and (not self._track or at_ns - self._track[-1][2] >= TRACK_NS):
            x, y = robot["position_m"][:2]
            self._track.append((round(x, 3), round(y, 3), at_ns))

    def _tell(self, told: str) -> None:
        with self._changed:
            if told != self._told:
                self._told = told
                self._version += 1
                self._changed.notify_all()

    def _ask_picture(self, extras: tuple[str, ...]) -> bool:
        """Without waiting, as `Pictures` wants it."""
        tap = self._tap
        if tap is None or not self._connected:
            return False
        with suppress(TapError):
            tap.send("picture", **{"with": list(extras)})
            return True
        return False

    def _link(self) -> dict[str, Any]:
        silent_s = time.monotonic() - self._heard_s
        if not self._connected:
            return {"state": "down", "says": self._told, "starts": self._starts}
        if silent_s > SILENT_S:
            return {"state": "silent", "says": f"nothing heard for {silent_s:.0f} s", "starts": self._starts}
        return {"state": "up", "says": "", "starts": self._starts}

    def _daemon(self) -> dict[str, Any] | None:
        if self._hello is None:
            return None
        return {key: self._hello.get(key) for key in ("version", "pid", "camera", "panels", "may")}

    def _checks(self) -> list[dict[str, Any]]:
        if self._hello is None or self._health is None:
            return []
        return [asdict(finding) for finding in checks(self._hello, self._health)]

    def _robot(self, now_ns: int) -> dict[str, Any] | None:
        """Tells where it was last, if that is not too long ago."""
        placed, moving = self._placed, self._moving
        if moving is not None and self._connected and moving.get("position_m") is not None:
            age_ms = round((now_ns - moving["t_ns"]) / 1e6, 1)
            if age_ms <= OLD_MS:
                return robot_of_state(moving) | {"age_ms": age_ms, "seq": self._decoded and self._decoded["seq"]}
        if placed is None or not self._connected:
            return None
        robot = robot_from_above(placed["robot"])
        age_ms = round((now_ns - placed["exposed_ns"]) / 1e6, 1)
        return None if robot is None or age_ms > GONE_MS else robot | {"age_ms": age_ms, "seq": placed["seq"]}

    def _no_fix(self, robot: dict[str, Any] | None) -> str | None:
        """Why the robot has no place now, so that it fits what the map shows; None where it has one."""
        if self._health is None or self._decoded is None or not self._connected:
            return None
        if robot is not None and robot["age_ms"] <= OLD_MS:
            return None
        said = str(self._health.get("no_fix"))
        if said not in _OF_FRAMES:
            return said
        reasons = [key.removeprefix("fix.") for key in self._decoded["rejected"] if key.startswith("fix.")]
        return reasons[0] if reasons else "stale" if self._decoded["markers"] else "no_panel"


_OF_FRAMES = ("none", "no_panel", "not_in_map", "rejected", "stale")  # of a second; a newer frame knows better
# What places are told in: of another camera, mount or map they are no places of this one.
_PLACES_IN = ("camera", "camera_mount", "panels", "map")
_KEPT = ("frames_per_s", "decoded_per_s", "decoded", "dropped_frames", "latency_ms", "temperature_c")
