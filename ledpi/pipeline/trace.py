"""Keeps a frame's steps, for those who want to see them: `Pipeline.decode` fills them in."""

from __future__ import annotations

from dataclasses import dataclass, field

from ledpi.core.records import Floats, Quad, Rejected
from ledpi.decode.evidence.cells import CellSamples
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.decision import Reading
from ledpi.decode.observation import Observation
from ledpi.decode.proposals import Candidate
from ledpi.decode.uemura import Steps


@dataclass(frozen=True, slots=True, kw_only=True)
class Dropped:
    """Something four-sided that was no panel."""

    corners_px: Floats  # (4, 2) as the picture shows it
    why: Rejected
    marker_id: int | None = None  # where it was read, and is not reported


@dataclass(frozen=True, slots=True, kw_only=True)
class SquareTrace:
    """One lit square, as the method `likelihood` has read it."""

    quad: Quad
    seen: Observation
    samples: CellSamples
    evidence: Evidence | Rejected  # of all frames that were used
    reading: Reading | Rejected


@dataclass(slots=True)
class Trace:
    """One frame. `likelihood` fills candidates and squares; `uemura` its steps, one for each pair of frequencies."""

    dropped: list[Dropped] = field(default_factory=list)
    candidates: list[Candidate] = field(default_factory=list)
    searched: bool = False  # the whole picture: a stream does so in every third frame, or where a panel is missing
    squares: list[SquareTrace] = field(default_factory=list)
    uemura: list[Steps] = field(default_factory=list)
