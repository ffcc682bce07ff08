"""The rolling-shutter simulator as a camera: paced like a sensor, or as fast as it is read."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Mapping
from dataclasses import asdict, replace

from ledpi.camera.recording.reader import TruthMarker
from ledpi.camera.simulate.render import Renderer
from ledpi.camera.simulate.scene import OV5647_FRAME_LENGTH_ROWS, OV5647_ROW_TIME_US, Scene, SimulatedSensor
from ledpi.camera.simulate.scenes import DRIVE_IDS, drive_scene, ov5647_lens, whole_rows_us
from ledpi.camera.simulate.sensor import sensor_info
from ledpi.camera.timing import choose_frame_length_rows
from ledpi.config.camera_yaml import load_intrinsics
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import CameraSettings, Config
from ledpi.config.values import check_lens
from ledpi.core.errors import CameraError, ConfigError, raising
from ledpi.core.records import CameraInfo, Frame, Intrinsics, PanelSpec, PanelValues, Pixels

_SPARE_ROWS = 4  # that the OV5647's driver keeps between the exposure and the frame's length
_BLANKING_ROWS = OV5647_FRAME_LENGTH_ROWS - 480

_log = logging.getLogger(__name__)


class SimulatedCamera:
    """Photographs a scene.

    `paced`: frame n exists from the end of its read-out on, the first one at the first `read`. As with a
    sensor, a reader that is too slow misses frames: those whose successor exists too are not rendered, are
    counted in `missed`, and leave a gap in `seq`. Not paced: every frame comes as soon as it is rendered,
    as if its read-out had just ended. It begins with frame `first`; after `frames` frames of the sensor, `read`
    returns None.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        seed: int,
        paced: bool,
        first: int = 0,
        frames: int | None = None,
        panel: PanelValues | None = None,
    ) -> None:
        self._sensor = scene.sensor
        self._renderer = Renderer(scene, seed=seed)
        self._renderer.light(0)  # what stands still is rendered here, and not late in the first frame
        self._paced = paced
        self._frames = frames
        self._panel = panel
        self._seq = first
        self._host_offset_ns: int | None = None  # of a paced camera, from its first frame on
        self._closed = threading.Event()
        self.missed = 0

    @property
    def info(self) -> CameraInfo:
        """As `Camera.info`."""
        return sensor_info(self._sensor)

    @property
    def panel(self) -> PanelValues | None:
        """As `Camera.panel`."""
        return self._panel

    def truth(self, seq: int) -> tuple[TruthMarker, ...]:
        """The markers that are in view in frame `seq`, and where they really are. From any thread."""
        return self._renderer.truth(seq)

    def read(self, into: Pixels) -> Frame | None:
        """As `Camera.read`; a simulated frame is never `Rejected`."""
        shape = (self._sensor.intrinsics.height, self._sensor.intrinsics.width)
        if into.shape != shape:
            raise CameraError(f"simulated camera: a frame needs an array of {shape}, not {into.shape}")
        seq = self._next_seq()
        if self._closed.is_set() or (self._frames is not None and seq >= self._frames):
            return None
        self._seq = seq + 1
        frame = self._renderer.frame(seq, into)
        host_offset_ns = self._wait_for_readout(seq)
        return None if self._closed.is_set() else replace(frame, host_offset_ns=host_offset_ns)

    def close(self) -> None:
        """As `Camera.close`."""
        self._closed.set()

    def _next_seq(self) -> int:
        """The frame that comes next, or, where the reader is late, the newest that exists already."""
        if self._host_offset_ns is None:
            return self._seq
        sensor, now_ns = self._sensor, time.monotonic_ns() - self._host_offset_ns
        period_ns = sensor.frame_length_rows * sensor.row_time_us * 1e3
        newest = int((now_ns - sensor.readout_end_ns(0)) / period_ns)
        if self._frames is not None:
            newest = min(newest, self._frames - 1)
        seq = max(self._seq, newest)
        self.missed += seq - self._seq
        return seq

    def _wait_for_readout(self, seq: int) -> int:
        """Waits, if paced, until the last row is read out, or `close`. Returns the frame's host_offset_ns."""
        end_ns = self._sensor.readout_end_ns(seq)
        if not self._paced:
            return time.monotonic_ns() - end_ns
        if self._host_offset_ns is None:
            self._host_offset_ns = time.monotonic_ns() - end_ns
            # So that whoever listens can tell from a packet's age which moment of the scene it is about.
            _log.info("simulated camera: time 0 of its scene is %d ns of CLOCK_MONOTONIC", self._host_offset_ns)
        while (left_ns := end_ns + self._host_offset_ns - time.monotonic_ns()) > 0:
            if self._closed.wait(left_ns * 1e-9):
                break
        return self._host_offset_ns


def open_simulated(config: Config, *, paced: bool, first: int = 0, frames: int | None = None) -> SimulatedCamera:
    """The robot that drives past two panels, 7 and 23, with the configuration's camera and panels.

    Raises ConfigError where the configuration asks for what the simulated sensor cannot do.
    """
    panels = config.panels
    sensor = simulated_sensor(config.camera, panels)
    scene = simulated_drive(sensor, {i: panels.spec(i) for i in DRIVE_IDS}, panels.dictionary)
    values = PanelValues(dictionary=panels.dictionary, **asdict(panels.spec()))
    return SimulatedCamera(scene, seed=0, paced=paced, first=first, frames=frames, panel=values)


def simulated_drive(sensor: SimulatedSensor, specs: Mapping[int, PanelSpec], dictionary: str) -> Scene:
    """The drive past panels 7 and 23. Raises ConfigError for a dictionary without them."""
    try:
        return drive_scene(sensor, specs, dictionary)
    except ValueError as error:
        ids = " and ".join(str(marker_id) for marker_id in DRIVE_IDS)
        raise ConfigError(f"panels.dictionary: the simulated drive shows {ids}: {error}") from None


def shortest_frame_rows(height: int, exposure_us: float, row_time_us: float) -> int:
    """Rows of the shortest frame: the picture and its blanking, or the exposure, whichever takes longer."""
    return max(height + _BLANKING_ROWS, round(exposure_us / row_time_us) + _SPARE_ROWS)


def simulated_sensor(camera: CameraSettings, panels: PanelSettings) -> SimulatedSensor:
    """An OV5647 with the configuration's picture size, lens, gain and transfer; exposure and period in whole rows.

    Raises ConfigError where it has no such exposure, or no frame period keeps the phases moving, and CalibrationError
    for a lens that is named and cannot be used, as a real camera's daemon does.
    """
    row_time_us = OV5647_ROW_TIME_US if camera.row_time_us == "auto" else camera.row_time_us
    exposure_us = whole_rows_us(camera.exposure_us, row_time_us)
    shortest = shortest_frame_rows(camera.height, exposure_us, row_time_us)
    if camera.frame_duration_us == "auto":
        frequencies = panels.frequencies_hz()
        try:
            rows = choose_frame_length_rows(shortest_rows=shortest, row_time_us=row_time_us, frequencies_hz=frequencies)
        except ValueError as error:
            raise ConfigError(str(error)) from None
    else:
        rows = max(shortest, round(camera.frame_duration_us / row_time_us))
    size = (camera.width, camera.height)
    with raising("camera", ConfigError):
        return SimulatedSensor(
            intrinsics=_own_lens(size) if camera.intrinsics is None else load_intrinsics(camera.intrinsics, size),
            exposure_us=exposure_us,
            row_time_us=row_time_us,
            frame_length_rows=rows,
            transfer="srgb" if camera.transfer == "auto" else camera.transfer,
            gain=1.0 if camera.analogue_gain == "auto" else camera.analogue_gain,
        )


def _own_lens(size: tuple[int, int]) -> Intrinsics:
    """Raises ValueError for a picture so narrow that no reader would take its lens for one."""
    lens = ov5647_lens(*size)
    check_lens(*size, fx=lens.fx, fy=lens.fy, cx=lens.cx, cy=lens.cy)
    return lens
