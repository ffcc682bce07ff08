"""The rate with the true corners given, on recordings that have truth: an upper bound for decoders of this kind."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from evaluation.suites.oracle import read_with_oracle
from ledpi.core.errors import RecordingError
from ledpi.core.records import Floats, Frame
from ledpi.recording.picture import read_picture
from ledpi.recording.reader import FrameEntry, Recording

RUN_GAP_NS = 60_000_000  # frames that are further apart belong to two takes


class Bound(NamedTuple):
    """Counts of panels wholly in view in the frames that count: how many are read, how many as another's ID."""

    read: int
    wrong: int
    total: int


@dataclass(frozen=True, slots=True)
class _View:
    """A panel in a frame, where it truly is, and the how-manieth frame of its take that is."""

    entry: FrameEntry
    place: int
    corners_px: Floats
    counts: bool  # it is wholly in view


@dataclass(slots=True)
class _Run:
    """One panel's views in one take."""

    marker_id: int
    views: list[_View] = field(default_factory=list)


def bound_of(recording: Recording, *, single: bool, skip: int = 0) -> Bound:
    """`single`: each frame by itself; else by all of its take until then. The first `skip` of a take do not count.

    Raises RecordingError where there is no truth, and where a picture cannot be read.
    """
    if recording.truth is None:
        raise RecordingError(f"{recording.folder}: has no truth.jsonl, which says where its panels are")
    total = Bound(0, 0, 0)
    for run in _runs(recording):
        judged = [view.counts and view.place >= skip for view in run.views]
        if not any(judged):
            continue
        groups: Sequence[Sequence[_View]] = [[view] for view in run.views] if single else [run.views]
        read = [marker_id for group in groups for marker_id in _read(recording, group)]
        ids = [marker_id for marker_id, counts in zip(read, judged, strict=True) if counts]
        right = sum(marker_id == run.marker_id for marker_id in ids)
        total = Bound(
            total.read + right,
            total.wrong + sum(marker_id is not None for marker_id in ids) - right,
            total.total + len(ids),
        )
    return total


def _runs(recording: Recording) -> Iterator[_Run]:
    """Panel by panel, take by take."""
    assert recording.truth is not None
    open_runs: dict[int, _Run] = {}
    last_ns, place = None, 0
    for entry in recording.frames:
        place = place + 1 if last_ns is not None and entry.row0_readout_ns - last_ns < RUN_GAP_NS else 0
        if place == 0:
            yield from open_runs.values()
            open_runs = {}
        last_ns = entry.row0_readout_ns
        for marker in recording.truth.get(entry.seq, ()):
            run = open_runs.setdefault(marker.id, _Run(marker.id))
            run.views.append(_View(entry, place, marker.corners_px, not marker.optional))
    yield from open_runs.values()


def _read(recording: Recording, views: Sequence[_View]) -> list[int | None]:
    seen = [(_frame(recording, view.entry), view.corners_px) for view in views]
    return read_with_oracle(seen, recording.camera.intrinsics, recording.dictionary, recording.panel)


def _frame(recording: Recording, entry: FrameEntry) -> Frame:
    pixels = np.empty((recording.camera.height, recording.camera.width), np.uint8)
    bad = read_picture(entry.picture, pixels)
    if bad is not None:
        raise RecordingError(bad.message)
    return recording.frame(entry, pixels)
