"""A recording as a camera, replayed as the sensor delivered it or as fast as it is read; and with values of --set."""

from __future__ import annotations

import itertools
import logging
import threading
import time
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path

from ledpi.camera.recording.picture import BadPicture, read_picture
from ledpi.camera.recording.reader import FrameEntry, Recording, load_recording
from ledpi.config.camera_yaml import load_intrinsics
from ledpi.config.panels import check_bands_visible
from ledpi.config.settings import Config
from ledpi.core.errors import ConfigError, raising
from ledpi.core.records import CameraInfo, Frame, PanelSpec, PanelValues, Pixels, Rejected

# Between the last frame and the first one of the next round the scene jumps, and so do the phases. More than half a
# second ends every track, as between two takes; so no decoder takes the jump for a motion. Less than a second, so that
# there are frames in each of the seconds that the daemon counts.
_ROUND_GAP_NS = 600_000_000
# A paced replay reads a picture in the second half of its read-out, and begins earlier only where reading takes long.
# Not as soon as the last one is handed over: decoding has just begun, and a sensor would leave it the interpreter and
# the caches (the hand-over to the decoder took 1.4 ms then, and takes 0.1 ms).
_READ_AHEAD = 2.0  # times the longest reading of late
# A sensor's last row comes when it comes; a thread that slept until then comes 0.1 to 0.2 ms later. So the end of the
# wait is spent awake.
_AWAKE_NS = 200_000
_FORGET = 0.9  # of the longest reading so far, from one picture to the next

_log = logging.getLogger(__name__)


class RecordingCamera:
    """Replays a recording.

    `paced`: each frame comes when its last row was read out, by the recording's own clock, gaps included. As
    with a sensor, a reader that is too slow loses frames: one whose successor is due already is passed over,
    counted in `missed`, and leaves a gap in `seq`. Not paced: every frame comes at once, as if its read-out
    had just ended.

    `loop` repeats the recording for ever; `seq` and time go on, with a gap between the rounds. `frames` ends
    the replay after so many. A picture that cannot be read is logged by its name and comes as `Rejected`.
    """

    def __init__(self, recording: Recording, *, paced: bool, loop: bool = False, frames: int | None = None) -> None:
        self._recording = recording
        self._paced = paced
        self._entries = itertools.islice(_rounds(recording.frames, loop), frames)
        self._upcoming = next(self._entries, None)
        self._host_offset_ns: int | None = None  # of a paced replay, once its first frame was delivered
        self._closed = threading.Event()
        self._readout_ns = round(recording.camera.height * recording.camera.row_time_us * 1e3)
        self._reading_ns = 0.0  # what it takes to read a picture: the longest of late
        self.missed = 0

    @property
    def info(self) -> CameraInfo:
        """The recording's own values; they override the configuration's."""
        return self._recording.camera

    @property
    def panel(self) -> PanelValues:
        """The panels that the recording shows."""
        return self._recording.panel_values

    def read(self, into: Pixels) -> Frame | Rejected | None:
        """As `Camera.read`."""
        entry = self._next()
        if entry is None or self._closed.is_set():
            return None
        end_ns = entry.row0_readout_ns + self._readout_ns
        host_offset_ns = self._host_offset_ns
        if host_offset_ns is not None:
            ahead_ns = max(0.5 * self._readout_ns, _READ_AHEAD * self._reading_ns)
            self._wait_until(end_ns + host_offset_ns - round(ahead_ns))
        bad = self._read_timed(entry, into)
        if host_offset_ns is None:
            host_offset_ns = time.monotonic_ns() - end_ns
        if self._paced:
            self._host_offset_ns = host_offset_ns
        frame = self._recording.frame(entry, into.view(), host_offset_ns=host_offset_ns)  # so that it only waits now
        self._wait_until(end_ns + host_offset_ns)
        if self._closed.is_set():
            return None
        if bad is not None:
            _log.warning("%s", bad.message)
            return bad.rejected
        return frame

    def close(self) -> None:
        """As `Camera.close`."""
        self._closed.set()

    def _next(self) -> FrameEntry | None:
        entry, self._upcoming = self._upcoming, next(self._entries, None)
        if self._host_offset_ns is not None:
            latest_ns = time.monotonic_ns() - self._readout_ns - self._host_offset_ns
            while self._upcoming is not None and self._upcoming.row0_readout_ns <= latest_ns:
                entry, self._upcoming = self._upcoming, next(self._entries, None)
                self.missed += 1
        return entry

    def _read_timed(self, entry: FrameEntry, into: Pixels) -> BadPicture | None:
        began_ns = time.monotonic_ns()
        bad = read_picture(entry.picture, into)
        self._reading_ns = max(time.monotonic_ns() - began_ns, _FORGET * self._reading_ns)
        return bad

    def _wait_until(self, host_ns: int) -> None:
        """Returns at that time, or at `close`."""
        while (left_ns := host_ns - time.monotonic_ns()) > 0:
            if left_ns > _AWAKE_NS and self._closed.wait((left_ns - _AWAKE_NS) * 1e-9):
                break


def _rounds(frames: tuple[FrameEntry, ...], loop: bool) -> Iterator[FrameEntry]:
    first, last = frames[0], frames[-1]
    for round_number in itertools.count() if loop else (0,):
        seq = round_number * (last.seq - first.seq + 1)
        time_ns = round_number * (last.row0_readout_ns - first.row0_readout_ns + _ROUND_GAP_NS)
        for entry in frames:
            yield replace(entry, seq=entry.seq + seq, row0_readout_ns=entry.row0_readout_ns + time_ns)


PANEL_KEYS = ("side_m", "black_hz", "white_hz", "duty", "phase")
# They belong to the pictures as they were taken; nothing that is said later changes them.
TAKEN_KEYS = ("width", "height", "frame_duration_us", "analogue_gain")


def load_recording_with(config: Config, folder: Path, *, as_reported: bool = False) -> Recording:
    """The recording in `folder`; what --set gave is stronger than what it says of its camera and its panels.

    `as_reported`: as `load_recording` has it.
    Raises ConfigError for what no recording can be made to have, and what `load_recording` and a lens raise.
    """
    recording = load_recording(folder, as_reported=as_reported)
    _check_taken(config, recording)
    changed = replace(
        recording,
        dictionary=config.panels.dictionary if _given(config, "panels.dictionary") else recording.dictionary,
        panel=_panel(config, recording),
        camera=camera_with(config, recording.camera),
        frames=tuple(replace(entry, exposure_us=config.camera.exposure_us) for entry in recording.frames)
        if _given(config, "camera.exposure_us")
        else recording.frames,
    )
    shown = config.panels.override_with(changed.panel_values)
    check_bands_visible(shown, changed.camera.row_time_us, f"--set: with what {folder} says of its camera and panel")
    return changed


def _given(config: Config, key: str) -> bool:
    return key in config.from_command_line


def _check_taken(config: Config, recording: Recording) -> None:
    for name in TAKEN_KEYS:
        asked = getattr(config.camera, name)
        own = getattr(recording.camera, name, None)  # of a gain, say, each frame has its own
        if _given(config, f"camera.{name}") and asked not in ("auto", own):
            has = "its frames have their own" if own is None else f"its pictures have {own}"
            raise ConfigError(f"--set camera.{name}={asked}: {recording.folder} is recorded, and {has}; leave it out")


def _panel(config: Config, recording: Recording) -> PanelSpec:
    values = asdict(recording.panel)
    given = {name: getattr(config.panels, name) for name in PANEL_KEYS if _given(config, f"panels.{name}")}
    with raising(f"--set panels: with what {recording.folder} says of its panel", ConfigError):
        return PanelSpec(**(values | given))


def camera_with(config: Config, camera: CameraInfo) -> CameraInfo:
    """A recording's or a picture's camera with what --set gave. Raises CalibrationError for a lens."""
    asked = config.camera
    if _given(config, "camera.exposure_us"):
        camera = replace(camera, exposure_us=asked.exposure_us)
    if _given(config, "camera.row_time_us") and asked.row_time_us != "auto":
        # Without the frames' rows, by which the stream would be found to take another time for each.
        camera = replace(camera, row_time_us=asked.row_time_us, frame_length_rows=None)
    if _given(config, "camera.transfer") and asked.transfer != "auto":
        camera = replace(camera, transfer=asked.transfer)
    if _given(config, "camera.rows_from"):
        camera = replace(camera, rows_from=asked.rows_from)
    if _given(config, "camera.intrinsics"):
        path = asked.intrinsics
        camera = replace(
            camera, intrinsics=None if path is None else load_intrinsics(path, (camera.width, camera.height))
        )
    return camera
