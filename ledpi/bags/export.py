"""A recording → a bag: its pictures as they are, and what `ledpi decode` gives for them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from ledpi.bags.bag_writer import BagWriter
from ledpi.config.camera_yaml import lens_of
from ledpi.config.robot import load_robot
from ledpi.config.settings import Config
from ledpi.core.errors import RecordingError
from ledpi.core.files import read_bytes, read_text
from ledpi.pipeline.pipeline import Pipeline
from ledpi.recording.format import FRAMES_FILE, HEADER_FILE, MAX_LINES_BYTES, TRUTH_FILE
from ledpi.recording.overrides import load_recording_with
from ledpi.recording.picture import MAX_BYTES, read_picture
from ledpi.recording.reader import Recording

NO_CLOCK = "does not say when it was taken (wall_clock_offset_ns): the bag's times begin in 1970"


def export_recording(config: Config, folder: Path, out: Path, warn: Callable[[str], None]) -> Iterator[int]:
    """Writes the bag, and yields after each frame how many there are. Broken pictures are left out with a warning.

    Raises LedpiError.
    """
    recording = load_recording_with(config, folder)
    pipeline = _pipeline(config, recording)
    lines, truth = _lines(folder / FRAMES_FILE), _lines(folder / TRUTH_FILE)
    offset_ns = recording.wall_clock_offset_ns
    if offset_ns is None:
        warn(f"{folder}: {NO_CLOCK}")
    picture = np.empty((recording.camera.height, recording.camera.width), np.uint8)
    with BagWriter(
        out,
        camera=recording.camera,
        dictionary=recording.dictionary,
        panel=recording.panel,
        header=read_text(folder / HEADER_FILE, RecordingError),
    ) as bag:
        for entry in recording.frames:
            fault = read_picture(entry.picture, picture)
            if fault is not None:
                warn(fault.message)
                continue
            frame = recording.frame(entry, picture.copy())
            bag.write_line(frame, lines[entry.seq], read_bytes(entry.picture, RecordingError, MAX_BYTES), offset_ns)
            bag.write_live(frame, pipeline.decode(frame))
            if entry.seq in truth:
                bag.write_truth(frame, truth[entry.seq])
            yield len(recording.frames)


def _pipeline(config: Config, recording: Recording) -> Pipeline:
    """As `ledpi decode` has it."""
    return Pipeline(
        recording.camera,
        config.panels,
        intrinsics=lens_of(recording.camera, config.camera.intrinsics),
        source_panel=recording.panel_values,
        robot=load_robot(config),
        method=config.decode.method,
    )


def _lines(path: Path) -> dict[int, str]:
    """By seq, as they stand there; a last one that is cut off is left out."""
    if not path.exists():
        return {}
    found = {}
    for text in read_text(path, RecordingError, MAX_LINES_BYTES).splitlines():
        try:
            found[int(json.loads(text)["seq"])] = text
        except ValueError:
            continue
    return found
