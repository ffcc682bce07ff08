"""At which other frequencies a panel may blink whose cells are found, and do not show the configured ones. Pure.

The evidence of one wave does not hang on which other wave is looked for beside it. So each frequency is weighed once,
and the codeword and the two frequencies that together explain most are proposed. It is a guess: whoever takes it up
reads the frame at these frequencies, with all that a reading asks for.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ledpi.core.codewords import Dictionary
from ledpi.core.records import Floats, Frame, Intrinsics, PanelSpec, Rejected
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.locate import Locator
from ledpi.decode.observation import Observation

# Below, bands are higher than most panels; above, next to nothing is left of them at most exposures. A step is 1.6 %,
# 47 Hz at 3 kHz: 10 ms leave no bands at each whole hundred hertz, so depth tells how far from one a panel is.
LOWEST_HZ, HIGHEST_HZ, STEPS = 300.0, 6000.0, 192
APART = 1.2  # that a panel's two frequencies are: nearer ones cannot be told apart in one frame


class Waves(NamedTuple):
    """The shares that each of the frequencies F explains."""

    hz: Floats  # (F,)
    score: Floats  # (F, cells, 2)
    information: Floats  # (F, cells, 2, cells, 2)
    prior: Floats  # (F,)


def propose(
    frame: Frame, corners_px: Floats, dictionary: Dictionary, lens: Intrinsics | None
) -> tuple[float, float] | None:
    """Black's and white's likeliest frequency, of the cells within corners (4, 2); None where cells cannot be had."""
    seen = _fitted(frame, corners_px, dictionary.cells_per_side, lens)
    waves = None if isinstance(seen, Rejected) else _weighed(seen, LightWeigher(dictionary.cells_per_side, lens))
    if waves is None:
        return None
    white = dictionary.rotated_codewords().reshape(4 * len(dictionary.codewords), -1).astype(np.float64)
    of_black, of_white = _likelihood(1.0 - white, waves), _likelihood(white, waves)
    apart = np.abs(np.log(waves.hz[:, None] / waves.hz)) > np.log(APART)
    together = np.where(apart, of_black[:, :, None] + of_white[:, None, :], -np.inf)
    _, black, other = np.unravel_index(int(together.argmax()), together.shape)
    return float(waves.hz[black]), float(waves.hz[other])


def _fitted(frame: Frame, corners_px: Floats, cells: int, lens: Intrinsics | None) -> Observation | Rejected:
    """The panel there, fitted without its bands' frequencies being known."""
    locator = Locator(cells, (_spec(LOWEST_HZ, HIGHEST_HZ),), lens, must_blink=False)
    quad = locator.localise(frame, corners_px)
    return quad if isinstance(quad, Rejected) else locator.observe(frame, quad)


def _spec(black_hz: float, white_hz: float) -> PanelSpec:
    return PanelSpec(side_m=1.0, black_hz=black_hz, white_hz=white_hz)


def _weighed(seen: Observation, weigher: LightWeigher) -> Waves | None:
    hz = np.geomspace(LOWEST_HZ, HIGHEST_HZ, STEPS)
    cells, half = weigher.cells**2, STEPS // 2
    score, information = np.empty((STEPS, cells, 2)), np.empty((STEPS, cells, 2, cells, 2))
    prior = np.empty(STEPS)
    for one in range(half):  # two at a time
        evidence = weigher.alone(seen, _spec(float(hz[one]), float(hz[one + half])))
        if evidence is None:
            return None
        for at, two in ((one, slice(0, 2)), (one + half, slice(2, 4))):
            score[at], prior[at] = evidence.score[:, two], evidence.prior[two][0]
            information[at] = evidence.information[:, two, :, two]
    return Waves(hz=hz, score=score, information=information, prior=prior)


def _likelihood(shows: Floats, waves: Waves) -> Floats:
    """(W, F) log-likelihood ratio to no bands of each wave in those cells of (W, cells) that show it."""
    flat = waves.information.transpose(0, 1, 3, 2, 4).reshape(len(waves.hz), -1, 4)
    both = np.einsum("wc,wd->wcd", shows, shows).reshape(len(shows), -1)
    of_class = np.einsum("wp,fpq->wfq", both, flat, optimize=True).reshape(len(shows), len(waves.hz), 2, 2)
    score = np.einsum("wc,fci->wfi", shows, waves.score)
    prior = np.maximum(waves.prior, 1e-12)[None, :, None, None]
    fitted = np.linalg.solve(of_class + np.eye(2) / prior, score[..., None])[..., 0]
    spread = np.linalg.slogdet(np.eye(2) + prior * of_class)[1]
    return np.asarray(0.5 * ((score * fitted).sum(axis=-1) - spread))
