"""What a frame went through, step by step, for those who want to see it: `Pipeline.decode` fills it in."""

from __future__ import annotations

from dataclasses import dataclass, field

from ledpi.core.records import Floats, Quad, Rejected
from ledpi.decode.uemura import Steps
from ledpi.decode.cells import CellSamples
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.decision import Reading
from ledpi.decode.proposals import Candidate
from ledpi.decode.reader import Outcome


@dataclass(frozen=True, slots=True, kw_only=True)
class Dropped:
    """Something four-sided that was no panel."""

    corners_px: Floats  # (4, 2) as the picture shows it
    why: Rejected


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """What `soft` made of one lit square."""

    quad: Quad
    samples: CellSamples
    evidence: Evidence | Rejected  # of all frames that were used
    reading: Reading | Rejected

    @classmethod
    def of(cls, quad: Quad, samples: CellSamples, outcome: Outcome) -> Look:
        """Of a square in which a frame has shown these `samples`."""
        shown, memories = outcome.shown, outcome.history.memories
        if isinstance(shown, Rejected):
            return cls(quad=quad, samples=samples, evidence=memories[0].evidence(), reading=shown)
        return cls(quad=quad, samples=samples, evidence=memories[shown.group].evidence(), reading=shown.reading)


@dataclass(slots=True)
class Trace:
    """Of one frame. Of `soft` the candidates and the looks, of `bands` the steps, one for each pair of frequencies."""

    dropped: list[Dropped] = field(default_factory=list)
    candidates: list[Candidate] = field(default_factory=list)
    looks: list[Look] = field(default_factory=list)
    bands: list[Steps] = field(default_factory=list)
