"""What a pipeline remembers between two frames, and the same as plain values, from which it can be made again."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np

from ledpi.core.records import Frame, PanelSpec
from ledpi.core.row_clock import ClockState
from ledpi.decode.agenda import Agenda
from ledpi.decode.cells import CellSamples, Lattice
from ledpi.decode.track import Followed
from ledpi.pipeline.plain import ArrayStore
from ledpi.pose.place import Placed


class PipelineState(NamedTuple):
    """All that the frames so far have left in a pipeline. Nothing in it ever changes: to take it is to copy nothing."""

    followed: Followed
    agenda: Agenda
    clock: ClockState
    placed: Placed
    off_frequency: tuple[tuple[int, PanelSpec], ...]  # by ID


class SharedRecords:
    """Frames' samples and times, which several records of a state share: each is written once."""

    def __init__(self) -> None:
        self.samples: dict[int, tuple[int, CellSamples]] = {}  # by identity: their number, and they themselves
        self.frames: dict[int, tuple[int, Frame]] = {}

    def number(self, one: CellSamples | Frame) -> int:
        """Of a record that may be there already."""
        known: dict[int, Any] = self.samples if isinstance(one, CellSamples) else self.frames
        return int(known.setdefault(id(one), (len(known), one))[0])


def as_plain(state: PipelineState, arrays: ArrayStore) -> dict[str, Any]:
    """The state as JSON has it, its arrays in `arrays`."""
    shared = SharedRecords()
    whole = _plain(state, arrays, shared)
    return {
        "samples": [_fields(samples, arrays, shared) for _, samples in shared.samples.values()],
        "frames": [_fields(frame, arrays, shared) for _, frame in shared.frames.values()],
        **whole,
    }


def _plain(value: Any, arrays: ArrayStore, shared: SharedRecords) -> Any:
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray):
        return arrays.add(value)
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Lattice):
        return value.k
    if isinstance(value, CellSamples | Frame):
        return shared.number(value)
    if is_dataclass(value) or hasattr(value, "_fields"):
        return _fields(value, arrays, shared)
    return [_plain(each, arrays, shared) for each in value]


def _fields(record: Any, arrays: ArrayStore, shared: SharedRecords) -> dict[str, Any]:
    names = [field.name for field in fields(record)] if is_dataclass(record) else record._fields
    return {name: _plain(getattr(record, name), arrays, shared) for name in names if name != "pixels"}


# Of a panel's evidence and its beliefs, and arrays that are as large as its samples in one frame: mean picture, waves,
# and what is expected.
_TRACK_BYTES, _TRACK_ARRAYS = 40_000, 20


def size_of(state: PipelineState) -> int:
    """Bytes that it may keep from being freed; no less than they are."""
    total = _TRACK_BYTES
    for _, history in state.followed.tracks:
        kept = [*history.search.observations, *(memory.last for memory in history.memories if memory.last is not None)]
        largest = max((samples.light.nbytes for samples, _ in kept), default=0)
        total += _TRACK_BYTES + largest * (2 * len(kept) + _TRACK_ARRAYS * len(history.memories))
    return total
