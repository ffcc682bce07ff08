"""What an antiphase panel would be worth: both classes at one frequency, half a cycle apart.

A cell that is taken for the other class is then off by twice its bands, whatever the phase; and as a class's light
fills the other's gaps, a panel of as many black cells as white ones does not flicker as a whole. But nothing tells a
word from its negative, half a cycle later, so a dictionary must have no word that is nearly another's negative.

The decoder does not read such panels yet. This judges them by its error model: the evidence of `information`, for one
frequency, and the decision of `decode.soft` with one wave in place of two.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ledpi.camera.timing import choose_frame_length_rows
from ledpi.decode.evidence import Doubles
from ledpi.decode.soft import FALSE_ID_RATE, FALSE_ID_RATE_ALONE, PRIOR_OF_NO_WORD
from ledpi.markers import Dictionary
from ledpi.panel.design import Task
from ledpi.panel.frequencies import worthwhile_frequencies
from ledpi.panel.information import STREAM_FRAMES, View, evidence_of
from ledpi.panel.reach import Reach

_DRAWS = 300


@dataclass(frozen=True, slots=True, kw_only=True)
class Antiphase:
    """The judgement."""

    frequency_hz: float
    distance_to_negatives: int  # cells by which a word differs, at least, from another's negative, however turned
    reach: Reach


def distance_to_negatives(dictionary: Dictionary) -> int:
    """Cells that tell a word from the negative of another word, or of itself when it is turned; the fewest."""
    signs = _signs(dictionary)
    apart = (signs.shape[1] + signs[::4] @ signs.T) / 2  # (IDs, turned words), to their negatives
    own = np.arange(len(apart))
    apart[own, 4 * own] = np.inf  # its own negative is the word half a cycle later
    return int(apart.min())


def judge_antiphase(task: Task, dictionary: Dictionary, views: Sequence[View]) -> Antiphase:
    """At the lowest frequency that is worth it, and the frame period that keeps it moving."""
    hz = worthwhile_frequencies(task.sensor.exposure_us, task.flicker.lowest_hz)[0]
    rows = choose_frame_length_rows(
        shortest_rows=task.sensor.frame_length_rows, row_time_us=task.sensor.row_time_us, frequencies_hz=(hz,)
    )
    depth = task.depths(hz, hz)[0]
    spec = task.spec(hz, 2 * hz)  # only black's half of the evidence is used
    chances: dict[int, list[float]] = {1: [], STREAM_FRAMES: []}
    for view in views:
        for frames, rate in ((1, FALSE_ID_RATE_ALONE), (STREAM_FRAMES, FALSE_ID_RATE)):
            information = evidence_of(view, spec, frames=frames, frame_length_rows=rows).information[:, :2, :, :2]
            chances[frames].append(_chance(information, dictionary, depth, rate))
    return Antiphase(
        frequency_hz=hz,
        distance_to_negatives=distance_to_negatives(dictionary),
        reach=Reach(
            distances_m=tuple(view.distance_m for view in views),
            alone=tuple(chances[1]),
            stream=tuple(chances[STREAM_FRAMES]),
        ),
    )


def _signs(dictionary: Dictionary) -> Doubles:
    """(4·IDs, cells) +1 for white, −1 for black; each word in its four turns."""
    words = dictionary.turned_words()
    return np.where(words.reshape(len(words) * 4, -1), 1.0, -1.0)


def _chance(information: Doubles, dictionary: Dictionary, depth: float, false_id_rate: float) -> float:
    """As `chances.chance_of_reading`, with one wave."""
    rng = np.random.default_rng(0)
    signs, cells = _signs(dictionary), len(information)
    matrix = information.reshape(2 * cells, 2 * cells)
    values, vectors = np.linalg.eigh(matrix)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    normal = np.einsum("wc,cidj,wd->wij", signs, information, signs, optimize=True) + 2.0 / depth**2 * np.eye(2)
    inverse, half_log_det = np.linalg.inv(normal), 0.5 * np.linalg.slogdet(normal * depth**2 / 2.0)[1]
    correctable = max(0, min(2 * dictionary.correctable_cells() + 1, distance_to_negatives(dictionary)) - 1) // 2
    right = 0
    for _ in range(_DRAWS):
        shown, phase = int(rng.integers(len(signs))), 2 * np.pi * rng.random()
        bands = np.outer(signs[shown], depth * np.array([np.cos(phase), np.sin(phase)]))
        score = (matrix @ bands.ravel() + root @ rng.standard_normal(2 * cells)).reshape(cells, 2)
        of_words = signs @ score
        fits = np.einsum("wij,wj->wi", inverse, of_words)
        likelihood = 0.5 * (fits * of_words).sum(axis=1) - half_log_det
        best = int(np.argmax(likelihood))
        rivals = np.append(np.delete(likelihood, best), 0.0)  # the last: no bands at all
        margin = min(
            float(likelihood[best] - rivals.max()),
            _odds_against_patterns(information, score, np.outer(signs[best], fits[best]), correctable, len(signs) // 4),
        )
        right += best == shown and margin >= -math.log(false_id_rate)
    return right / _DRAWS


def _odds_against_patterns(information: Doubles, score: Doubles, shown: Doubles, correctable: int, words: int) -> float:
    """As `decode.soft` weighs a word against all patterns that are none; a pattern and its negative are one."""
    cells = len(score)
    left = score - np.einsum("cidj,dj->ci", information, shown)
    own = np.einsum("cicj->cij", information)
    gain = (-2 * shown * left).sum(axis=1) - 2 * np.einsum("ci,cij,cj->c", shown, own, shown)
    by_distance = np.zeros(cells + 1)
    by_distance[0] = 1.0
    for ratio in np.exp(np.minimum(gain, 40.0)).tolist():
        by_distance[1:] += by_distance[:-1] * ratio
    prior = math.log((1 - PRIOR_OF_NO_WORD) / words / PRIOR_OF_NO_WORD) + (cells - 1) * math.log(2)
    return prior - math.log(max(float(by_distance[correctable + 1 : cells - correctable].sum()), 1e-300))
