"""Frames to calibrate with, from whatever `camera.source` names: a camera, or a recording as fast as it is read."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ledpi.camera.base import AdjustableGain, Camera
from ledpi.camera.factory import open_camera
from ledpi.camera.gain import GainControl, brightest_level
from ledpi.camera.recording import RecordingCamera
from ledpi.config.camera_yaml import lens_of
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import Config
from ledpi.core.errors import CalibrationError
from ledpi.core.records import MAX_GAP_NS, CameraInfo, Frame, Intrinsics, PanelValues, Rejected
from ledpi.decode.evidence.cells import SATURATED
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pipeline.trace import Trace
from ledpi.recording.overrides import load_recording_with

MIN_FRAMES = 20
SETTLE_FRAMES = 300  # five seconds: the gain's sweep takes two


@dataclass(frozen=True, slots=True, kw_only=True)
class Taken:
    """One unbroken series of frames, and what its source says of itself."""

    frames: list[Frame]
    camera: CameraInfo
    panel: PanelValues | None
    intrinsics: Intrinsics | None
    row_time_ratio: float  # row time and exposure, as they are here, over what the driver reports


def take_frames(config: Config, count: int, advance: Callable[[int], None]) -> Taken:
    """Takes `count` frames, or all that a recording has. Of several takes, the longest one.

    Raises CalibrationError where there are too few, and what the camera itself raises.
    """
    source = config.camera.source
    kind, _, place = source.partition(":")
    camera: Camera
    ratio = 1.0
    if kind == "recording":
        recording = load_recording_with(config, Path(place))
        camera, ratio = RecordingCamera(recording, paced=False), recording.row_time_ratio
    else:
        camera = open_camera(config, paced=kind != "simulated")
    try:
        settle_gain(camera, config.panels)
        frames = []
        for frame in _read(camera, count):
            frames.append(frame)
            advance(1)
        intrinsics = lens_of(camera.info, config.camera.intrinsics)
    finally:
        camera.close()
    take = longest_take(frames)
    if len(take) < MIN_FRAMES:
        raise CalibrationError(f"{source}: {len(take)} usable frames in a row; at least {MIN_FRAMES} are needed")
    return Taken(frames=take, camera=camera.info, panel=camera.panel, intrinsics=intrinsics, row_time_ratio=ratio)


def settle_gain(camera: Camera, panels: PanelSettings) -> None:
    """Waits, where the gain is left open, until the brightest lit square is as bright as a panel should be.

    It need not be read as a panel: how it blinks is what is to be found out. Gives up after SETTLE_FRAMES.
    """
    limits = camera.gain_limits if isinstance(camera, AdjustableGain) else None
    if limits is None or not isinstance(camera, AdjustableGain):
        return
    control = GainControl(limits)
    pipeline = Pipeline(camera.info, panels, intrinsics=None, stream=False)
    for frame in _read(camera, SETTLE_FRAMES):
        trace = Trace()
        pipeline.decode(frame, trace)
        squares = [square.quad.corners_px for square in trace.squares]
        squares += [dropped.corners_px for dropped in trace.dropped if dropped.why == SATURATED]
        gain = control.update(frame.row0_readout_ns, frame.analogue_gain, brightest_level(frame, squares))
        if gain is not None:
            camera.set_gain(gain)
        if control.settled:
            return


def _read(camera: Camera, count: int) -> Iterator[Frame]:
    """At most `count` usable frames; ends with the camera's, or when as many were of no use."""
    used = unusable = 0
    while used < count and unusable < count:
        frame = camera.read(np.empty((camera.info.height, camera.info.width), np.uint8))
        if frame is None:
            return
        if isinstance(frame, Rejected):
            unusable += 1
        else:
            used += 1
            yield frame


def longest_take(frames: list[Frame]) -> list[Frame]:
    """The longest run of frames without a gap of more than half a second."""
    takes: list[list[Frame]] = [[]]
    for frame in frames:
        if takes[-1] and frame.row0_readout_ns - takes[-1][-1].row0_readout_ns > MAX_GAP_NS:
            takes.append([])
        takes[-1].append(frame)
    return max(takes, key=len)
