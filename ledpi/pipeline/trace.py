"""Keeps a frame's steps, and the evidence of each cell, for people: `Pipeline.decode` fills them in."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ledpi.core.codewords import Bits
from ledpi.core.records import Floats, Quad, Rejected
from ledpi.decode.evidence.cells import CellSamples, Observation
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.codewords import class_flip_gain
from ledpi.decode.identify.decision import Reading
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


FREE_PARAMETERS = 4  # of the bands of two frequencies: cosine and sine of each


def class_given_others(evidence: Evidence, cell_bands: Floats, codeword: Bits) -> Floats:
    """(cells,) by how much likelier all the light of a panel that was read is with this cell white than with it black.

    `cell_bands` (cells, P) are its bands, `codeword` (cells,) the cells that are white in it.
    """
    gain = class_flip_gain(evidence, cell_bands)
    return np.asarray(np.where(codeword, -gain, gain))


def class_alone(evidence: Evidence) -> Floats:
    """(cells,) log-likelihood ratio of white to black in each cell alone, of two frequencies; phase integrated out."""
    nats = []
    for two in (slice(0, 2), slice(2, 4)):
        prior = np.diag(evidence.prior[two])
        own = evidence.own_information[:, two, two]
        b = evidence.score[:, two]
        fitted = np.linalg.solve(own + np.linalg.inv(prior), b[..., None])[..., 0]
        nats.append(0.5 * ((b * fitted).sum(axis=1) - np.linalg.slogdet(np.eye(2) + prior @ own)[1]))
    return np.asarray(nats[1] - nats[0])


def classes_unread(square: SquareTrace) -> Floats | None:
    """(n, n) `class_alone` of a square that was not read; None where no cell says anything by itself."""
    evidence = square.evidence
    if not isinstance(evidence, Evidence) or len(evidence.prior) != FREE_PARAMETERS:
        return None
    nats = class_alone(evidence)
    side = math.isqrt(len(nats))
    return nats.reshape(side, side)
