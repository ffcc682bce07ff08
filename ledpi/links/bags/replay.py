"""A recording, decoded once more, for what is made of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from ledpi.camera.recorded import load_recording_with
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
        for entry in self.recording.frames:
            frame = self.recording.read(entry)
            if isinstance(frame, Frame):
                yield Replayed(entry, frame, self._pipeline.decode(frame))
            else:
                warn(frame.message)
