"""A glance at candidates before anything is fitted: how much likelier is a panel there than smooth texture?

On a picture where a cell has 5 to 10 pixels all panels look alike. The template of such a picture, its slopes, and what
varies in it are made once; glance.c looks at all candidates of a frame in one call. Light is about what is
dark, in units of what is bright less that; lengths are in cells.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from ledpi.core.records import Floats, read_only
from ledpi.decode.finding.find import Hypothesis, Template
from ledpi.decode.model.prior import BESIDE_SIGMA, BLUR_PX, DARK_SIGMA, GAIN_SIGMA, GAP_MEAN, NEVER

EACH, BEYOND = 5, 2  # samples along a cell, and beyond each side
BLUR = 0.24  # of a picture where a cell has so few pixels: their own width, and the lens'
HARMONICS = ((1, 0), (0, 1))  # of the profile that cells share, across and down
SHAPE_SIGMA = 0.4
NOISE = 0.02  # variance of what such a template leaves of a panel's light, a seventh of it
# Half the side: by how much a proposal's homography is wrong in each of eight ways, before it is moved and after.
FIRST_WAY, WAY = 0.15, 0.03
GAIN, BESIDE, ALL = (
    0.3,
    0.5,
    0.2,
)  # deviations of most panels' cells and sides, where those of a fit's prior hold all; of all light
TEXTURE = 0.2  # variance of texture as smooth as cells are wide, half of it the mean's
LEAST = 0.3  # of the noise: what varies by less is not told from it


def varying(mean: Floats, ways: Floats) -> Hypothesis:
    """Returns what varies about its `mean` (samples,) by ways (N, samples), each by a deviation of its length."""
    _, lengths, directions = np.linalg.svd(ways, full_matrices=False)
    variance = np.square(lengths)
    clear = variance > LEAST * NOISE
    share = np.sqrt(variance[clear] / (variance[clear] + NOISE))
    return Hypothesis(mean, share[:, None] * directions[clear], float(np.log1p(variance / NOISE).sum()))


@lru_cache(maxsize=4)
def template(cells: int) -> Template:
    """Makes that of panels of `cells` × `cells`."""
    at = (np.arange(-BEYOND, cells * EACH + BEYOND) + 0.5) / EACH
    levels, ways, mean = _slopes(cells, at)
    count, sides, rest = cells * cells, np.ones(4), np.array([DARK_SIGMA, *(SHAPE_SIGMA for _ in HARMONICS)])
    first = np.concatenate([np.full(count, GAIN_SIGMA), BESIDE_SIGMA * sides, rest, np.full(len(ways), FIRST_WAY)])
    after = np.concatenate([np.full(count, GAIN), BESIDE * sides, rest, np.full(len(ways), WAY)])
    slopes = np.concatenate([levels, ways])
    projection = np.linalg.solve(slopes @ slopes.T + NOISE * np.diag(first**-2.0), slopes)
    variance, along = np.linalg.eigh(np.exp(-0.5 * np.subtract.outer(at, at) ** 2))  # of texture, along a line
    texture = np.kron(*(2 * [(along * np.sqrt(np.maximum(variance, 0.0)))[:, variance > NEVER].T]))
    within = (at > 0) & (at < cells)
    return Template(
        along=read_only(at / cells),
        inside=read_only(np.outer(within, within).reshape(-1)),
        gains=projection[:count],
        ways=projection[-len(ways) :],
        panel=varying(mean, np.concatenate([after[:, None] * slopes, ALL * mean[None]])),
        texture=varying(
            np.full(len(mean), 0.5), math.sqrt(TEXTURE / 2) * np.concatenate([texture, np.ones((1, len(mean)))])
        ),
        independent=len(mean) / (4.0 * math.pi * BLUR_PX**2),  # white noise, blurred by as much, of a sample a pixel
    )


def _slopes(cells: int, at: Floats) -> tuple[Floats, Floats, Floats]:
    """(unknowns, samples) slopes of the light by gains, sides, the room and harmonics, and (8, samples) by the ways in
    which a homography can be wrong; and (samples,) the light of a panel of even cells.
    """
    ends = np.arange(cells + 1)[:, None] + 0.5 * GAP_MEAN * np.array([-1, 1])  # of the cell before, and of the next
    ends[0], ends[-1] = 0, cells  # there is no gap
    before, after = (at - ends[:-1, 1:]) / BLUR, (at - ends[1:, :1]) / BLUR
    light, slope = _below(before) - _below(after), (_density(before) - _density(after)) / BLUR  # (cells, lines)
    one, left, right = np.ones(len(at)), _below(-at / BLUR), _below((at - cells) / BLUR)
    within, total, steep = 1.0 - left - right, light.sum(axis=0), slope.sum(axis=0)
    from_middle = at - np.clip(np.floor(at), 0, cells - 1) - 0.5
    levels = [np.outer(down, across) for down in light for across in light]
    levels += [
        np.outer(one, left),
        np.outer(one, right),
        np.outer(left, within),
        np.outer(right, within),
        np.outer(one, one),
    ]
    levels += [np.outer(*(total * np.cos(2 * np.pi * n * from_middle) for n in (b, a))) for a, b in HARMONICS]
    q, p = np.meshgrid(2 * at / cells - 1, 2 * at / cells - 1, indexing="ij")
    across, down = cells / 2 * np.outer(total, steep), cells / 2 * np.outer(steep, total)
    both = p * across + q * down
    ways = [across, p * across, q * across, down, p * down, q * down, p * both, q * both]
    samples = len(at) ** 2
    return np.reshape(levels, (-1, samples)), np.reshape(ways, (-1, samples)), np.outer(total, total).reshape(-1)


def _below(z: Floats) -> Floats:
    return np.asarray(0.5 + 0.5 * np.vectorize(math.erf)(z / math.sqrt(2)))


def _density(z: Floats) -> Floats:
    return np.asarray(np.exp(-0.5 * z * z)) / math.sqrt(2 * math.pi)
