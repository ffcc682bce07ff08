"""A recording → a bag: its pictures as they are, and what `ledpi decode` gives for them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from ledpi.camera.recording.format import FRAMES_FILE, HEADER_FILE, MAX_LINES_BYTES, TRUTH_FILE
from ledpi.camera.recording.picture import MAX_BYTES
from ledpi.core.errors import RecordingError
from ledpi.core.files import nothing_left, read_bytes, read_text
from ledpi.links.bags.bag_writer import BagWriter
from ledpi.links.bags.replay import Replay, Warn

NO_CLOCK = "does not say when it was taken (wall_clock_offset_ns): the bag's times begin in 1970"


def export_bag(replay: Replay, out: Path, warn: Warn) -> Iterator[None]:
    """Writes it, and yields after each frame. Raises LedpiError; where the disk is full, nothing is left of it."""
    recording = replay.recording
    lines, truth = (_lines(recording.folder / name) for name in (FRAMES_FILE, TRUTH_FILE))
    offset_ns = recording.wall_clock_offset_ns
    if offset_ns is None:
        warn(f"{recording.folder}: {NO_CLOCK}")
    with (
        nothing_left(out),
        BagWriter(
            out,
            camera=recording.camera,
            dictionary=recording.dictionary,
            panel=recording.panel,
            header=read_text(recording.folder / HEADER_FILE, RecordingError),
        ) as bag,
    ):
        for entry, frame, decoded in replay.frames(warn):
            bag.write_line(frame, lines[entry.seq], read_bytes(entry.picture, RecordingError, MAX_BYTES), offset_ns)
            bag.write_live(frame, decoded)
            if entry.seq in truth:
                bag.write_truth(frame, truth[entry.seq])
            yield


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
