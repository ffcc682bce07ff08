"""A pipeline's state beside a recording: `state.bin`, from which it is decoded as it was live, from its first frame on.

A line of JSON, `{"ledpi_state": 1, "bytes": N, "state": {…}}`, then N bytes of arrays, little-endian. No pickle: a
recording may come from anybody, and whatever is in it, no more is made of it than the records of `state`.
"""

from __future__ import annotations

import json
from pathlib import Path

from ledpi.core.errors import RecordingError
from ledpi.core.files import read_bytes
from ledpi.core.wording import shortened
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pipeline.plain import ArrayStore, Node
from ledpi.pipeline.state import PipelineState, as_plain
from ledpi.pipeline.state_parser import StateParser

STATE_FILE = "state.bin"
VERSION = 1
MAX_BYTES = 64 * 1024 * 1024  # a panel takes half a megabyte at most


def as_bytes(state: PipelineState) -> bytes:
    """The file's content."""
    arrays = ArrayStore()
    plain = as_plain(state, arrays)
    line = json.dumps({"ledpi_state": VERSION, "bytes": arrays.size, "state": plain}, separators=(",", ":"))
    return b"".join([line.encode("ascii"), b"\n", *arrays.parts])


def resume_from(folder: Path, pipeline: Pipeline) -> bool:
    """Gives the pipeline what the one had that decoded the recording in `folder` live; False where that is not kept.

    Raises RecordingError where the file cannot be read, or does not fit what this pipeline looks for.
    """
    path = folder / STATE_FILE
    if not path.exists():
        return False
    try:
        pipeline.resume(_state(read_bytes(path, RecordingError, MAX_BYTES), pipeline))
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None
    return True


def _state(content: bytes, pipeline: Pipeline) -> PipelineState:
    head, line_break, arrays = content.partition(b"\n")
    try:
        values = json.loads(head)
    except (ValueError, RecursionError):
        raise ValueError("begins with no line of JSON; must be as ledpi writes it") from None
    if not isinstance(values, dict) or values.get("ledpi_state") != VERSION:
        found = shortened(values.get("ledpi_state")) if isinstance(values, dict) else shortened(values)
        raise ValueError(f"ledpi_state: must be {VERSION}, not {found}")
    node = Node(values, arrays)
    if not line_break or node["bytes"].integer() != len(arrays):
        raise ValueError(f"has {len(arrays)} bytes of arrays; must have the {shortened(values['bytes'])} that it says")
    return StateParser(pipeline.cells, pipeline.specs).state(Node(node["state"].value, arrays))
