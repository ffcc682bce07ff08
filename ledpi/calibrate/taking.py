"""Frames to calibrate with, from whatever `camera.source` names: a camera, or a recording as fast as it is read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ledpi.camera.factory import open_camera
from ledpi.config import Config
from ledpi.daemon import calibration
from ledpi.errors import CalibrationError
from ledpi.recording import load_recording
from ledpi.records import CameraInfo, Frame, Intrinsics, PanelValues, Rejected

FEWEST_FRAMES = 20
MAX_GAP_NS = 500_000_000  # a longer one begins another take, as the recording format says


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
    ratio = load_recording(Path(place)).row_time_ratio if kind == "recording" else 1.0
    camera = open_camera(config, paced=kind not in ("simulated", "recording"))
    frames: list[Frame] = []
    unusable = 0
    try:
        while len(frames) < count and unusable < count:
            frame = camera.read(np.empty((camera.info.height, camera.info.width), np.uint8))
            if frame is None:
                break
            if isinstance(frame, Rejected):
                unusable += 1
            else:
                frames.append(frame)
                advance(1)
        intrinsics = calibration(config, camera)
    finally:
        camera.close()
    take = longest_take(frames)
    if len(take) < FEWEST_FRAMES:
        raise CalibrationError(f"{source}: {len(take)} usable frames in a row; at least {FEWEST_FRAMES} are needed")
    return Taken(
        frames=take, camera=camera.info, panel=camera.panel, intrinsics=intrinsics, row_time_ratio=ratio
    )


def longest_take(frames: list[Frame]) -> list[Frame]:
    """The longest run of frames without a gap of more than half a second."""
    takes: list[list[Frame]] = [[]]
    for frame in frames:
        if takes[-1] and frame.row0_readout_ns - takes[-1][-1].row0_readout_ns > MAX_GAP_NS:
            takes.append([])
        takes[-1].append(frame)
    return max(takes, key=len)
