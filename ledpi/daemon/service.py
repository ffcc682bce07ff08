"""The life of `ledpi run`: one daemon, and after a change of the configuration another."""

from __future__ import annotations

import logging
import queue
from collections.abc import Callable
from typing import Any

from ledpi import __version__
from ledpi.camera.base import Camera
from ledpi.config.panels import check_bands_visible
from ledpi.config.settings import Config
from ledpi.core.errors import ConfigError, LedpiError, RecordingError, TapAgainError, one_line
from ledpi.daemon.daemon import Daemon
from ledpi.daemon.health import Totals
from ledpi.daemon.observers import close_tap, open_tap
from ledpi.daemon.reload import NO_HANDOVER, Handover, Reading
from ledpi.daemon.reporting import event, notify
from ledpi.daemon.tap.protocol import Request
from ledpi.daemon.tap.server import Tap
from ledpi.wire.mavlink import Resets

MAX_QUOTED = 200  # characters of an error that nobody has foreseen
RELOADED_S = 60.0  # within which a client of the tap hears what has become of it

_log = logging.getLogger("ledpi")


class Service:
    """Runs until `stop`, or until the camera has no further frame; `reload` takes the configuration anew."""

    def __init__(
        self, load: Callable[[], Config], open_camera: Callable[[Config], Camera], *, lossless: bool = False
    ) -> None:
        """`lossless`: as Daemon's. Raises LedpiError where the first configuration or its camera cannot be used."""
        self._load, self._open_camera, self._lossless = load, open_camera, lossless
        self._asked_to_stop = self._asked_to_reload = self._asked_to_save = self._has_changed = False
        self._reading: Reading | None = None
        self._next: Config | None = None
        self._heard: queue.SimpleQueue[str] | None = None  # for who has asked by the tap: the error, or ""
        self._resets = Resets()
        self._config = load()
        self._tap = open_tap(self._config)
        try:
            self._daemon = self._start(self._config, self._tap)
        except BaseException:
            close_tap(self._tap)
            raise

    def stop(self) -> None:
        """From a signal handler: takes no lock."""
        self._asked_to_stop = True
        self._daemon.stop()

    def reload(self) -> None:
        """From a signal handler: takes no lock. The work is done in the thread that runs."""
        self._asked_to_reload = True

    def reload_for_tap(self, request: Request) -> dict[str, Any]:
        """As `reload`, from a thread of the tap: waits for what becomes of it. Raises LedpiError."""
        self._heard = heard = queue.SimpleQueue[str]()
        self.reload()
        try:
            error = heard.get(timeout=RELOADED_S)
        except queue.Empty:
            raise TapAgainError("the configuration is not there yet; does a mount hang?") from None
        if error:
            raise ConfigError(f"{error}; the old configuration stays")
        return {}

    def save(self) -> None:
        """The last seconds, as a recording. From a signal handler: takes no lock."""
        self._asked_to_save = True

    def run(self) -> Totals:
        """Runs daemons, one after the other; returns what the last came to. Raises what stopped it."""
        try:
            while True:
                totals = self._daemon.run(self._handle_requests)
                config, self._next = self._next, None
                if config is None or self._asked_to_stop:
                    return totals
                self._daemon = self._change_to(config)
                if self._asked_to_stop:  # while there was no daemon to tell
                    self._daemon.stop()
        finally:
            notify("STOPPING=1")
            self._daemon.handover.close()
            close_tap(self._tap)

    def _handle_requests(self) -> None:
        """A configuration that can be read ends the daemon, for another one to begin; a bad one is named."""
        if self._has_changed:
            self._has_changed = False
            self._tell("")
        if self._asked_to_save:
            self._asked_to_save = False
            try:
                self._daemon.save()  # the journal hears what becomes of it
            except RecordingError as error:
                _log.warning(event("rewind_failed", reason=str(error)))
        if self._asked_to_reload and self._reading is None:
            self._asked_to_reload, self._reading = False, Reading(self._load)
        if self._reading is None:
            return
        result = self._reading.result()
        if result is None:
            if self._reading.is_slow():
                _log.warning(event("reload_waits", reason="its files are still being read; does a mount hang?"))
            return
        self._reading = None
        if isinstance(result, Exception):
            self._refuse(result)
        else:
            self._next = result
            self._daemon.hand_over(result)

    def _change_to(self, config: Config) -> Daemon:
        """Changes to it; what only the camera shows to be wrong brings the old configuration back."""
        notify("WATCHDOG=1")  # the old daemon has ended as it should; a camera, or two, may be about to be opened
        tap, left = self._tap, self._daemon.handover
        try:
            tap = open_tap(config, self._tap)
            daemon = self._start(config, tap, left)
        except Exception as error:
            close_tap(tap, but=self._tap)
            self._refuse(error)
            return self._start(self._config, self._tap, left)
        self._has_changed = True
        close_tap(self._tap, but=tap)
        self._config, self._tap = config, tap
        return daemon

    def _start(self, config: Config, tap: Tap | None, left: Handover = NO_HANDOVER) -> Daemon:
        camera = left.camera or self._open_camera(config)
        try:
            shown = config.panels if camera.panel is None else config.panels.override_with(camera.panel)
            check_bands_visible(shown, camera.info.row_time_us, "configuration")
            daemon = Daemon(
                config, camera, lossless=self._lossless, resets=self._resets, tap=tap, publisher=left.publisher
            )
            if tap is not None:
                tap.offer("reload", self.reload_for_tap)
        except BaseException:
            if camera is not left.camera:
                camera.close()
            raise
        info = camera.info
        _log.info(
            event(
                "start",
                version=__version__,
                source=config.camera.source,
                size=f"{info.width}x{info.height}",
                exposure_us=info.exposure_us,
                row_time_us=info.row_time_us,
                calibrated=daemon.calibrated,
                map=config.map,
                method=config.decode.method,
                port=config.serial.port,
                baud=config.serial.baud,
                protocol=config.serial.protocol,
                tap=None if tap is None else tap.path,
            )
        )
        return daemon

    def _refuse(self, error: Exception) -> None:
        what = str(error) if isinstance(error, LedpiError) else f"{type(error).__name__}: {str(error)[:MAX_QUOTED]}"
        self._tell(what)
        _log.error(event("reload_refused", error=one_line(what), stays="the old configuration"))

    def _tell(self, error: str) -> None:
        heard, self._heard = self._heard, None
        if heard is not None:
            heard.put(error)
