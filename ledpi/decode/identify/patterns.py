"""How well patterns that are no word explain the evidence of all of a panel's cells together.

In C (kernels/neighbours.c, climb.c) and, where there is no compiler, in numpy, which is the reference.
"""

from __future__ import annotations

import math

import numpy as np

from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.words import word_log_likelihoods
from ledpi.kernels import words as kernel
from ledpi.kernels.library import compiled
from ledpi.records import Singles

BEAM = 16  # patterns from which others are tried that differ in one more cell: with 8, the likeliest was missed
# To find the likeliest pattern: phases of each wave that are begun with, patterns that are followed, and how far. (Of
# 800 panels and decoys it is the likeliest of all 65,536 but for 7, and there within 5 nats of it.)
PHASES, CLIMBERS, CLIMBS = 8, 4, 5


def of_neighbours(evidence: Evidence, word: Singles, nearest: int, furthest: int) -> float:
    """Log of the summed likelihoods of patterns that differ from a word (cells,) in `nearest` to `furthest` cells.

    Each has the bands that fit it best. Of all these patterns those are tried that are near the likeliest, found from
    the word outward; cells that are silent are left as they are.
    """
    if compiled():
        known = evidence.score, evidence.information, evidence.prior
        return kernel.of_neighbours(*known, word, nearest, furthest)
    here, total = word[None], -np.inf
    each = np.eye(len(word), dtype=word.dtype)[~evidence.silent]
    for differ in range(1, furthest + 1):
        tried = np.abs(here[:, None] - each).reshape(-1, len(word))
        tried = np.unique(tried[np.abs(tried - word).sum(axis=1) == differ], axis=0)
        likelihood = word_log_likelihoods(evidence, tried)[0]
        if differ >= nearest:
            total = np.logaddexp(total, np.logaddexp.reduce(likelihood))
        here = tried[np.argsort(-likelihood)[:BEAM]]
    return float(total)


def likeliest_beyond(evidence: Evidence, word: Singles, correctable: int) -> tuple[float, Singles]:
    """The likeliest pattern that is too far from a word (cells,) to be it: how likely, over "no bands", and which.

    It differs in more cells than are `correctable`, and has the bands that fit it best. It is sought from the word and
    from many phases, each cell as they fit it best: then one cell after the other. Cells that are silent are left as
    they are; in antiphase a pattern's negative is the pattern.
    """
    if compiled():
        return kernel.likeliest_beyond(evidence.score, evidence.information, evidence.prior, word, correctable)
    told = ~evidence.silent
    each = np.eye(len(word), dtype=word.dtype)[told]
    patterns = np.concatenate([word[None], np.where(told, _as_phases_have_it(evidence), word)])
    likeliest, beyond = -math.inf, word
    for _ in range(CLIMBS):
        patterns = np.unique(patterns, axis=0)
        likelihood = word_log_likelihoods(evidence, patterns)[0]
        differ = np.abs(patterns - word).sum(axis=1)
        if len(evidence.prior) == 2:
            differ = np.minimum(differ, len(each) - differ)
        for at in np.flatnonzero(differ > correctable):
            if likelihood[at] > likeliest or np.isnan(likelihood[at]):
                likeliest, beyond = float(likelihood[at]), patterns[at]
        best = patterns[np.argsort(-likelihood)[:CLIMBERS]]
        patterns = np.concatenate([best, np.abs(best[:, None] - each).reshape(-1, len(word))])
    return likeliest, beyond


def _as_phases_have_it(evidence: Evidence) -> Singles:
    """(N, cells) patterns: which class fits each cell better, for PHASES of each wave, as deep as expected."""
    turns = 2 * np.pi * np.arange(PHASES) / PHASES
    depth = np.sqrt(2.0 * evidence.prior[::2])
    waves = [np.stack([d * np.cos(turns), d * np.sin(turns)], axis=1) for d in depth]  # (PHASES, 2) each
    own = evidence.of_own_bands
    if len(waves) == 1:  # antiphase: a class is the other's negative
        white = (evidence.score @ waves[0].T).T < 0
    else:
        black, light = (
            evidence.score[:, at] @ wave.T - 0.5 * np.einsum("pi,cij,pj->cp", wave, own[:, at, at], wave)
            for at, wave in zip((slice(0, 2), slice(2, 4)), waves, strict=True)
        )
        white = (light[:, None] > black[:, :, None]).reshape(len(own), -1).T
    return np.asarray(white, np.float32)
