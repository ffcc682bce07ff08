"""A reload: the configuration read beside the daemon that runs, and devices that run on."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from ledpi.camera.base import Camera
from ledpi.camera.recorded import load_recording_with
from ledpi.config.camera_yaml import load_intrinsics
from ledpi.config.check import load_own_map
from ledpi.config.settings import Config
from ledpi.core.errors import CameraError
from ledpi.core.records import Floats
from ledpi.wire.line import Ear
from ledpi.wire.mavlink import Mavlink, Resets
from ledpi.wire.publisher import Publisher

SLOW_S = 3.0  # a map of a thousand panels takes one on a Raspberry Pi


class Handover(NamedTuple):
    """Things that a daemon leaves to the next one: running, and not to be opened again."""

    camera: Camera | None
    publisher: Publisher | None

    def close(self) -> None:
        """Closes them, as there is no next one."""
        if self.camera is not None:
            with suppress(CameraError, OSError):
                self.camera.close()
        if self.publisher is not None:
            self.publisher.stop()


NO_HANDOVER = Handover(camera=None, publisher=None)


def publisher_of(
    config: Config, base_link_from_camera: Floats, resets: Resets, ear: Ear | None, left: Publisher | None = None
) -> Publisher:
    """The one that was left, as this configuration has it, or a new one, not started.

    Raises ConfigError where MAVLink is asked for and pymavlink is missing.
    """
    mavlink = None
    if config.serial.protocol == "mavlink":
        mavlink = Mavlink(
            base_link_from_camera=base_link_from_camera,
            profile=config.serial.mavlink_profile,
            system=config.serial.mavlink_system,
            resets=resets,
            tells_state=config.state_hz > 0 and config.odometry.source != "none",  # what drives: others may fly
        )
    if left is None:
        return Publisher(config.serial, mavlink, map_resets=resets.maps, ear=ear)
    left.begin_anew(config.serial, mavlink, map_resets=resets.maps, ear=ear)
    return left


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
    load_own_map(config)
    kind, _, place = config.camera.source.partition(":")
    lens_is_known = kind == "recording" and load_recording_with(config, Path(place)).camera.intrinsics is not None
    if config.camera.intrinsics is not None and not lens_is_known:
        load_intrinsics(config.camera.intrinsics)
