"""A recording, decoded once more, for what is made of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ledpi.camera.recorded import load_recording_with
from ledpi.camera.recording.picture import read_picture
from ledpi.camera.recording.reader import FrameEntry, Recording
from ledpi.config.camera_yaml import lens_of
from ledpi.config.settings import Config
from ledpi.core.records import Decoded, Frame
from ledpi.pipeline.pipeline import pipeline_of

Warn = Callable[[str], None]


class Replayed(NamedTuple):
    """One frame."""

    entry: FrameEntry
    frame: Frame
    decoded: Decoded


class Replay:
    """As `ledpi decode` has it. Raises LedpiError."""

    def __init__(self, config: Config, folder: Path) -> None:
        self.recording: Recording = load_recording_with(config, folder)
        camera = self.recording.camera
        lens = lens_of(camera, config.camera.intrinsics)
        self._pipeline = pipeline_of(config, camera, lens, self.recording.panel_values)

    def frames(self, warn: Warn) -> Iterator[Replayed]:
        """Each in its order; broken pictures are left out with a warning."""
        camera = self.recording.camera
        picture = np.empty((camera.height, camera.width), np.uint8)
        for entry in self.recording.frames:
            fault = read_picture(entry.picture, picture)
            if fault is not None:
                warn(fault.message)
                continue
            frame = self.recording.frame(entry, picture.copy())
            yield Replayed(entry, frame, self._pipeline.decode(frame))
