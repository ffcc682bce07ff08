"""Who sees what the daemon decodes, beside the controller: clients of the tap, and what keeps or writes frames."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import Any

from ledpi.config.origins import origins_of, values_of
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import Config
from ledpi.core.errors import ConfigError, RecordingError
from ledpi.core.records import CameraInfo, Decoded, Frame, Intrinsics, PanelMap
from ledpi.daemon.kept_takes import KeptTakes
from ledpi.daemon.reporting import event
from ledpi.daemon.rewind import ASKED, Rewind, TapRecorder
from ledpi.daemon.robot_state import Now
from ledpi.daemon.takes import Shown
from ledpi.daemon.tap import messages
from ledpi.daemon.tap.messages import Setup
from ledpi.daemon.tap.places import AUTO, to_serve
from ledpi.daemon.tap.protocol import COMMANDS, Request
from ledpi.daemon.tap.server import Tap
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pipeline.trace import Trace
from ledpi.state.inputs import Odometry

_log = logging.getLogger("ledpi")


def open_tap(config: Config, now: Tap | None = None) -> Tap | None:
    """The tap that this configuration asks for: `now`, if that is where it is, and can still be found there.

    Raises ConfigError where a path is given at which none can be. Where `auto` finds no place the daemon runs without:
    a robot needs its poses more than anybody needs to look at them.
    """
    setting = config.tap.socket
    if setting is None:
        return None
    try:
        path = to_serve(setting)
        if now is not None and now.path == path and now.is_there:
            return now
        tap = Tap(path)
    except ConfigError as error:
        if setting != AUTO:
            raise
        _log.warning(event("tap_off", reason=str(error)))
        return None
    tap.start()
    return tap


def close_tap(tap: Tap | None, but: Tap | None = None) -> None:
    """Closes it, if there is one and it is not the one that goes on."""
    if tap is not None and tap is not but:
        tap.close()


def setup_of(
    config: Config, camera: CameraInfo, panels: PanelSettings, lens: Intrinsics | None, panel_map: PanelMap | None
) -> Setup:
    """Returns what a follower is told first. `panels`: with what the camera knows better."""
    return Setup(
        pid=os.getpid(),
        camera=camera,
        source=config.camera.source,
        intrinsics=lens,
        panels=panels,
        panel_map=panel_map,
        values=values_of(config),
        origins=origins_of(config),
        config_path=None if config.file is None else str(config.file),
    )


class Observers:
    """Observers of one daemon. `trace` and `keep` are for its decode thread, the rest for its main one."""

    def __init__(
        self, config: Config, pipeline: Pipeline, camera: CameraInfo, period_ms: float, setup: Setup, tap: Tap | None
    ) -> None:
        """`camera`: with the lens that poses are solved with. `period_ms`: between two frames."""
        self._tap, self._setup = tap, setup
        shown = Shown(camera, pipeline.panels.dictionary, pipeline.panels.spec(), config.camera.source)
        self._rewind = Rewind(config.rewind, shown, period_ms) if config.rewind.seconds else None
        self._recorder = None if tap is None else TapRecorder(shown)

    def start(self, odometry: Callable[[Odometry], None] | None) -> None:
        """Before the first frame. `odometry` takes that of the tap's clients; None: theirs is not asked for."""
        if self._tap is None or self._recorder is None:
            return
        if self._rewind is not None:
            self._tap.offer("save", self._save_for_tap)
        self._tap.offer("record", self._recorder.record)
        self._tap.offer("record_stop", self._recorder.stop)
        if odometry is not None:
            self._tap.offer("odometry", partial(_pass_odometry, odometry))
        kept = KeptTakes()
        self._tap.offer("takes", kept.list)
        self._tap.offer("take", kept.read)
        self._tap.offer("take_delete", kept.delete)
        self._tap.begin(self._setup)

    def save(self, cause: str = ASKED) -> Future[Path]:
        """The last seconds' recording, once it is whole; from any thread. Raises RecordingError where none are kept."""
        if self._rewind is None:
            raise RecordingError("rewind: is off; set rewind.seconds")
        return self._rewind.save(cause)

    def trace(self) -> Trace | None:
        """Returns what the next frame's decoding is to fill in; None: nothing."""
        return None if self._tap is None else self._tap.trace()

    def keep(self, frame: Frame, decoded: Decoded, search_budget: int, trace: Trace | None) -> None:
        """A frame that was just decoded, while its pixels are there."""
        rewind = self._rewind
        if rewind is not None:
            rewind.keep(frame, decoded, search_budget)
        if self._recorder is not None:
            self._recorder.keep(frame, decoded, search_budget)
        if self._tap is not None:
            self._tap.show(frame, decoded, trace)

    def tick(self, now_ns: int, *, lost: bool) -> None:
        """Some times a second; `lost`: the camera is."""
        if self._rewind is not None:
            self._rewind.tick(now_ns, lost=lost)

    @property
    def has_followers(self) -> bool:
        """Tells whether anybody would get what `send_health` sends."""
        return self._tap is not None and self._tap.is_followed

    def send_health(self, health: dict[str, Any]) -> None:
        """To the followers of the tap."""
        if self._tap is not None:
            kept_s = None if self._rewind is None else round(self._rewind.kept_s, 1)
            self._tap.tell(health | {"kept_s": kept_s})

    def send_state(self, now: Now) -> None:
        """To the followers of the tap; from the state's own thread."""
        if self._tap is not None and self._tap.is_followed:
            self._tap.tell_state(messages.robot_state(now.state, now.t_ns, now.message))

    def end(self) -> None:
        """No more frames are written than wait already."""
        if self._rewind is not None:
            self._rewind.stop()
        if self._recorder is not None:
            self._recorder.end()

    def close(self) -> None:
        """After the last frame; waits for what is being written, a moment at most."""
        if self._tap is not None and self._recorder is not None:
            for do in COMMANDS:  # `reload`, too: until there is a daemon again
                self._tap.offer(do, None)
            self._recorder.close()
        if self._rewind is not None:
            self._rewind.close()
            self._rewind = None  # its memory is free for the next daemon's

    def _save_for_tap(self, request: Request) -> dict[str, Any]:
        return {"path": str(self.save().result())}


def _pass_odometry(take: Callable[[Odometry], None], request: Request) -> dict[str, Any]:
    assert request.odometry is not None
    take(request.odometry)
    return {}
