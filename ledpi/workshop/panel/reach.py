"""The reach of a pair of frequencies: chances that a panel is read by the decoder, by distance.

Of a panel that shows the codeword w with bands x, the score of the evidence is normal with mean I·X and covariance I,
with X = the bands of each cell's class, and I the information of `information.evidence_of`. The draws go through
`decode.decision.decide` as a camera's do. What the model leaves out: whether the square is found at all, corners that
are off by more than their first order, harmonics of the wave, what the optics mix between cells.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ledpi.core.codewords import Dictionary
from ledpi.core.records import Floats, Rejected
from ledpi.decode.evidence.classes import wave_shares
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify import decision
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.decision import FALSE_ID_RATE
from ledpi.workshop.panel.design import ENOUGH_NATS, Proposal, Task, farthest_m
from ledpi.workshop.panel.information import STREAM_FRAMES, View, evidence_of, separation_nats, view_panel

RELIABLE = 0.9  # the chance up to which a panel counts as within range
DRAWS = 300  # a case
# Where the outcome is certain nothing is drawn: far more than enough information, or far from it.
_CERTAIN_NATS, _HOPELESS_NATS = 3 * ENOUGH_NATS, ENOUGH_NATS / 20
DISTANCES = 14  # evenly in their logarithm
_NEAREST_SHARE = 0.05  # of the farthest; nearer than that all pairs are read


def chance_of_reading(
    evidence: Evidence, codebook: Codebook, depths: tuple[float, float], false_id_rate: float, *, draws: int
) -> float:
    """The share of draws (ID, phases, noise) that are read as what they are; `depths` as in `separation_nats`."""
    rng = np.random.default_rng(0)
    size = evidence.score.size
    information = evidence.information.reshape(size, size)
    values, vectors = np.linalg.eigh(information)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    right = 0
    for _ in range(draws):
        shown = int(rng.integers(len(codebook.white)))
        bands = _bands(codebook.white[shown].astype(np.float64), depths, rng, len(evidence.prior) // 2)
        score = information @ bands.ravel() + root @ rng.standard_normal(size)
        drawn = evidence._replace(score=score.reshape(evidence.score.shape))
        read = decision.decide(drawn, codebook, false_id_rate)
        if not isinstance(read, Rejected):
            right += read.id == codebook.ids[shown] and read.quarter_turns == codebook.quarter_turns[shown]
    return right / draws


def _bands(white: Floats, depths: tuple[float, float], rng: np.random.Generator, waves: int) -> Floats:
    """(cells, 2·waves) cosine and sine of what each cell shows, at random phases."""
    shares = wave_shares(white, waves)
    out = np.zeros((len(white), 2 * waves))
    for k in range(waves):
        phase = 2 * np.pi * rng.random()
        out[:, 2 * k] = depths[k] * np.cos(phase) * shares[:, k]
        out[:, 2 * k + 1] = depths[k] * np.sin(phase) * shares[:, k]
    return out


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """Chances of being read, by distance: of one frame alone, and of the last of STREAM_FRAMES."""

    distances_m: tuple[float, ...]
    alone: tuple[float, ...]
    stream: tuple[float, ...]

    def range_m(self, chances: Sequence[float]) -> float | None:
        """Returns how far every chance is RELIABLE, read off between distances; None where not even the nearest is."""
        count = [chance >= RELIABLE for chance in (*chances, 0.0)].index(False)
        if count == 0 or count == len(chances):
            return self.distances_m[-1] if count else None
        (near_m, far_m), (before, after) = self.distances_m[count - 1 : count + 1], chances[count - 1 : count + 1]
        return near_m * math.exp(math.log(far_m / near_m) * (before - RELIABLE) / (before - after))

    def carries_m2(self) -> float:
        """Range alone times range of a stream: how far a panel carries, in one number; 0 for nowhere."""
        return (self.range_m(self.alone) or 0.0) * (self.range_m(self.stream) or 0.0)

    def is_beyond(self, other: Reach) -> bool:
        """Tells whether it is read further than `other` in one respect, and as far in the other, to 0.1 m."""
        own, others = ([round(r.range_m(c) or 0.0, 1) for c in (r.alone, r.stream)] for r in (self, other))
        return own != others and all(mine >= theirs for mine, theirs in zip(own, others, strict=True))


def reach_views(task: Task) -> list[View]:
    """Pictures of a panel from all distances at which there is any hope."""
    farthest = farthest_m(task.sensor, task.side_m, task.cells)
    distances = np.geomspace(_NEAREST_SHARE * farthest, farthest, DISTANCES)
    views = (view_panel(task.sensor, task.cells, task.side_m, float(d)) for d in distances)
    return [view for view in views if isinstance(view, View)]


def reach_of(
    task: Task,
    proposal: Proposal,
    dictionary: Dictionary,
    views: Sequence[View],
    advance: Callable[[int], None] = lambda count: None,
) -> Reach:
    """Draws from the decoder's error model at each distance."""
    spec, depths = task.spec(proposal.black_hz, proposal.white_hz), task.depths(proposal.black_hz, proposal.white_hz)
    codebook = Codebook.build(list(range(len(dictionary.codewords))), dictionary, spec)
    most = task.coherent_frames(max(proposal.black_hz, proposal.white_hz), proposal.frame_length_rows)
    chances: dict[int, list[float]] = {1: [], STREAM_FRAMES: []}
    for view in views:
        for frames in (1, STREAM_FRAMES):
            known = evidence_of(view, spec, frames=min(frames, most), frame_length_rows=proposal.frame_length_rows)
            nats = separation_nats(known, depths)
            if _HOPELESS_NATS < nats < _CERTAIN_NATS:
                chances[frames].append(chance_of_reading(known, codebook, depths, FALSE_ID_RATE, draws=DRAWS))
            else:
                chances[frames].append(float(nats >= _CERTAIN_NATS))
        advance(1)
    return Reach(
        distances_m=tuple(view.distance_m for view in views),
        alone=tuple(chances[1]),
        stream=tuple(chances[STREAM_FRAMES]),
    )
