"""`ledpi run`, without its command line: capture thread → ring → decode worker → publisher."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from ledpi.camera.base import Camera, GainFollower
from ledpi.camera.factory import exposure_notes, is_same_camera
from ledpi.camera.recovering import LOST
from ledpi.config.camera_yaml import lens_of
from ledpi.config.check import unreadable_note
from ledpi.config.settings import Config
from ledpi.core.errors import CameraError
from ledpi.core.records import CameraInfo, Decoded, Frame, Rejected
from ledpi.daemon.health import Health, RecentPackets, Totals, health, minute_line, second_line, status
from ledpi.daemon.liveness import Liveness, Pacing
from ledpi.daemon.observers import Observers, setup_of
from ledpi.daemon.reload import NO_HANDOVER, Handover, publisher_of
from ledpi.daemon.reporting import Watchdog, is_service, notify
from ledpi.daemon.rewind import ASKED
from ledpi.daemon.ring import FrameRing
from ledpi.daemon.robot_state import Now, robot_state_of
from ledpi.daemon.tap.server import Tap
from ledpi.daemon.threads import Workers, keep_for_good, keep_memory, switch_promptly
from ledpi.decode.identify.frequency_search import off_frequency_note
from ledpi.pipeline.pipeline import Pipeline, load_robot, pipeline_of
from ledpi.pose.fix import Robot
from ledpi.wire.mavlink import Resets
from ledpi.wire.message import NoFix, State, StatusMessage
from ledpi.wire.publisher import Publisher

TICK_S = 0.1  # between two updates of the status
HEALTH_EVERY_S = 1.0  # times and temperature are read
MINUTE_S = 60.0
CLOSE_S = 2.0  # for a camera, which a reload opens again. A driver that hangs must not keep the controller's last word

STARTING = StatusMessage(state=State.STARTING, no_fix=NoFix.NOT_RUNNING)

_log = logging.getLogger("ledpi")


class Daemon:
    """One run over one camera."""

    def __init__(
        self,
        config: Config,
        camera: Camera,
        *,
        lossless: bool = False,
        resets: Resets | None = None,
        tap: Tap | None = None,
        publisher: Publisher | None = None,
    ) -> None:
        """`lossless`: capture waits for the decoder, for a camera that has no pace of its own.

        `resets`: where jumps and changes of the map are counted, with those of the daemons before. `tap`: who follows
        sees what is decoded. `publisher`: one that a daemon before has left, with its port.
        """
        info = camera.info
        self._config = config
        self._camera = camera
        self._lossless = lossless
        self._calibrated = lens_of(info, config.camera.intrinsics)
        self._has_map = config.map is not None
        self._ring = FrameRing(info.height, info.width)
        robot = load_robot(config)
        self._pipeline = pipeline_of(config, info, self._calibrated, camera.panel, robot=robot)
        setup = setup_of(config, info, self._pipeline.panels, self._calibrated, robot.panels)
        lens = replace(info, intrinsics=self._calibrated)
        self._observers = Observers(config, self._pipeline, lens, info.frame_period_ms, setup, tap)
        self._pacing = None if self._lossless else Pacing(info.frame_period_ms)
        self._gain = GainFollower(camera)
        _warn(config, self._pipeline, info, robot)
        resets = resets or Resets()
        resets.update_map(robot.panels)
        self._handover = NO_HANDOVER
        self._health = Health()
        self._state = robot_state_of(config, robot, resets, self._tell_state, self._health.reject)
        ear = self._state if config.hears_controller else None
        self._publisher = publisher_of(config, robot.base_link_from_camera, resets, ear, publisher)
        self._noted_off_frequency: set[int] = set()  # panels that blink at other frequencies than configured
        self._liveness = Liveness()
        self._partial_results = 0  # of frames, as they were known
        self._status_lock = threading.Lock()
        self._asked_to_stop = False
        self._started_s = time.monotonic()
        self._workers = Workers(self._capture, self._decode, *(() if self._state is None else (self._state.run,)))

    @property
    def calibrated(self) -> bool:
        """Tells whether the lens is known, and poses can be sent."""
        return self._calibrated is not None

    def stop(self) -> None:
        """Ends `run` soon. From any thread or signal handler: takes no lock, as an Event would.

        A handler runs in the middle of whatever `run` does; were that the Event's own lock, nothing would ever end.
        """
        self._asked_to_stop = True

    def hand_over(self, config: Config) -> None:
        """Ends `run` soon, for a daemon with this configuration: what that would open in the same way stays open."""
        self._handover = Handover(
            camera=self._camera if is_same_camera(self._config, config) else None,
            publisher=self._publisher if self._publisher.fits(config.serial, hears=config.hears_controller) else None,
        )
        self.stop()

    @property
    def handover(self) -> Handover:
        """After `run`: what runs on for the next one."""
        return self._handover

    def save(self, cause: str = ASKED) -> Future[Path]:
        """Writes the last seconds; its folder once it is whole. From any thread. Raises RecordingError, as it may."""
        return self._observers.save(cause)

    def run(self, at_each_tick: Callable[[], None] = lambda: None) -> Totals:
        """Until `stop`, or until the camera has no further frame. Raises what stopped a worker.

        `at_each_tick` is called ten times a second, in the calling thread.
        """
        switch_promptly()
        keep_memory()
        keep_for_good()
        if self._calibrated is None:
            _log.warning("camera.intrinsics is not set: IDs are sent flagged uncalibrated, without poses")
        self._publisher.set_status(STARTING)
        try:
            self._publisher.start()
            state = self._state if self._config.odometry.source == "tap" else None
            self._observers.start(None if state is None else state.tell_odometry)
            self._workers.start()
            notify("READY=1")
            self._watch(at_each_tick)
        finally:
            self._close()
        failure = self._workers.failure or self._publisher.failure
        if failure is not None:
            raise failure
        return self._totals()

    def _close(self) -> None:
        self._workers.stop.set()
        if self._state is not None:
            self._state.stop()
        self._observers.end()
        if self._handover.camera is None or not self._workers.join(
            self._capture
        ):  # a camera that hangs is opened again
            self._handover = self._handover._replace(camera=None)
            closing = threading.Thread(target=self._close_camera, name="close", daemon=True)
            try:
                closing.start()
            except RuntimeError:  # the system has no further thread
                self._close_camera()
            else:
                closing.join(CLOSE_S)
            self._workers.join(self._capture)
        self._ring.close()
        self._workers.join(self._decode)
        self._send_status()  # the last status counts every frame
        if self._handover.publisher is None:
            self._publisher.stop()
        else:
            self._publisher.set_status(STARTING)
        self._observers.close()

    def _close_camera(self) -> None:
        with suppress(CameraError, OSError):
            self._camera.close()

    def _tell_state(self, now: Now) -> None:
        self._publisher.set_state(now.message, now.t_ns)
        self._observers.send_state(now)

    def _capture(self) -> None:
        while not self._workers.stop.is_set():
            result = self._camera.read(self._ring.acquire())
            if result is None:
                break
            if isinstance(result, Rejected):
                self._health.reject(result)
                if result == LOST and self._liveness.loses():
                    self._send_status()  # at once, without waiting for the next tick
                continue
            if self._liveness.delivers():
                self._send_status()
            self._ring.publish(result)
            while self._lossless and not self._workers.stop.is_set() and not self._ring.wait_until_taken(TICK_S):
                self._liveness.delivers()
        self._ring.close()

    def _send_status(self) -> None:
        """To the controller. One thread at a time, so that the last one sent is the newest."""
        with self._status_lock:
            self._publisher.set_status(self._status())

    def _status(self) -> StatusMessage:
        return status(
            self._totals(),
            self._liveness,
            uptime_s=time.monotonic() - self._started_s,
            calibrated=self.calibrated,
            has_map=self._has_map,
        )

    def _decode(self) -> None:
        while True:
            frame = self._ring.take(TICK_S)
            if frame is not None:
                self._decode_one(frame)
            elif self._ring.closed:
                break
        self._workers.stop.set()

    def _decode_one(self, frame: Frame) -> None:
        path = self._pipeline.likelihood
        self._liveness.begins(frame)
        spent, budget = path.spent, path.search_budget
        trace = self._observers.trace()
        decoded = self._pipeline.decode(frame, trace, on_partial=self._publish_partial)
        if self._pacing is not None:
            path.search_budget = self._pacing.budget_after(path.spent - spent, sum(decoded.stage_ms.values()))
        self._gain.update(frame, decoded)
        if self._state is not None:
            decoded = self._state.see(decoded)
        self._observers.keep(frame, decoded, budget, trace)
        self._ring.release()
        self._health.add(decoded)
        self._liveness.ends()
        for marker_id in path.off_frequency.keys() - self._noted_off_frequency:
            self._noted_off_frequency.add(marker_id)
            _log.warning("%s", off_frequency_note(marker_id, path.off_frequency[marker_id]))

    def _publish_partial(self, news: Decoded) -> None:
        """A piece of what the frame in work shows."""
        self._publisher.publish(news)
        self._partial_results += 1

    def _watch(self, at_each_tick: Callable[[], None]) -> None:
        """Keeps status and health up to date until it is time to stop."""
        last, health_s, minute_s = self._totals(), time.monotonic(), time.monotonic()
        watchdog, recent = Watchdog(), RecentPackets(last.packets)
        while not self._workers.stop.wait(TICK_S) and not self._asked_to_stop and self._publisher.failure is None:
            at_each_tick()
            now_s = time.monotonic()
            self._liveness.tick()
            self._send_status()
            self._observers.tick(time.monotonic_ns(), lost=self._liveness.lost)
            totals = self._totals()
            watchdog.update(self._steps(totals))
            self._publisher.name_others()
            if now_s - health_s >= HEALTH_EVERY_S:
                self._health.refresh()
                totals = self._totals()
                packets = recent.add(totals.packets)
                if self._observers.has_followers:
                    self._observers.send_health(health(last, totals, now_s - health_s, self._status(), packets))
                if not is_service():
                    _log.info(second_line(last, totals, now_s - health_s))
                elif now_s - minute_s >= MINUTE_S:
                    _log.info(minute_line(totals))
                    minute_s = now_s
                last, health_s = totals, now_s

    def _steps(self, totals: Totals) -> int:
        """Counts progress: in frames, within a frame, or in opening a lost camera until that gives up."""
        return totals.decoded + self._partial_results + totals.rejected.get(LOST.key, 0)

    def _totals(self) -> Totals:
        return self._health.totals(self._ring.counters(), self._publisher.counters)


def _warn(config: Config, pipeline: Pipeline, info: CameraInfo, robot: Robot) -> None:
    """Warns of what is no error, and probably not meant."""
    if note := unreadable_note(config.panels, robot.panels, config.map):
        _log.warning("map: %s", note)
    for note in exposure_notes(config, pipeline.panels, info):
        _log.warning("%s", note)
