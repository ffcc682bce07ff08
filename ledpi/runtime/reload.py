"""A changed configuration, read beside the daemon that runs."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

from ledpi.config.camera_yaml import load_intrinsics
from ledpi.config.robot import load_robot
from ledpi.config.settings import Config
from ledpi.recording.overrides import load_recording_with

SLOW_S = 3.0  # a map of a thousand panels takes one on a Raspberry Pi


class Reading:
    """Reads in a thread of its own: a file may lie on a mount that hangs, and take for ever."""

    def __init__(self, load: Callable[[], Config]) -> None:
        self._load = load
        self._result: Config | Exception | None = None
        self._began_s = time.monotonic()
        self._slow_is_told = False
        self._thread = threading.Thread(target=self._read, name="reload", daemon=True)
        try:
            self._thread.start()
        except RuntimeError as error:  # the system has no further thread
            self._result = error

    def _read(self) -> None:
        try:
            config = self._load()
            _read_ahead(config)
            self._result = config
        except Exception as error:  # whatever a file may bring about, the old configuration stays
            self._result = error

    def result(self) -> Config | Exception | None:
        """The configuration, or why there is none; None while it is still read."""
        return None if self._thread.is_alive() else self._result

    def is_slow(self) -> bool:
        """Tells whether it takes so long that somebody should know; True once only."""
        if self._slow_is_told or time.monotonic() - self._began_s < SLOW_S:
            return False
        self._slow_is_told = True
        return True


def _read_ahead(config: Config) -> None:
    """Reads the files that a configuration names, to find out before the old daemon has ended. Raises LedpiError."""
    load_robot(config)
    kind, _, place = config.camera.source.partition(":")
    lens_is_known = kind == "recording" and load_recording_with(config, Path(place)).camera.intrinsics is not None
    if config.camera.intrinsics is not None and not lens_is_known:
        load_intrinsics(config.camera.intrinsics)
