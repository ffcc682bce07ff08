"""What a fit leaves of white noise: how alike that makes samples next to each other, and how a blur changes it.

`noise` says why. Nothing here is of a picture: it all follows from how a cell's samples are interpolated, and from what
is fitted to them.
"""

from __future__ import annotations

import math
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Doubles = NDArray[np.float64]
Step = tuple[float, float]  # across and down the picture, in pixels

REACH, FINE = 4, 64  # of Lanczos's kernel on either side, in pixels, and points to a pixel in tables of it
ROUNDED_PX = 0.05  # lattices alike are taken for one
BLUR = 0.5  # over the lag, that tells g
RIDGE = 1e-5  # as in the fit: what explains less of a cell than that is as good as not fitted


class Lags(NamedTuple):
    """Which of a cell's samples are compared."""

    aside: int  # how many further those are that a pixel is apart, across the lattice
    below: int  # and down it; 0: none are compared that way
    rim: int  # rows and columns at each side of the cell that are left out


def pairs(k: int, lags: Lags, times: int) -> int:
    """Of a cell's samples that are so many lags apart, aside or below."""
    inner = k - 2 * lags.rim
    return sum(inner * (inner - times * lag) for lag in (lags.aside, lags.below) if lag)


def likeness(across: Step, down: Step, lags: Lags, linear: bool) -> float:
    """r of white noise, by interpolation alone."""
    table = _interpolated(0.0, linear)
    apart = []
    for times in (1, 2):
        each = [(times * lag * x, times * lag * y) for lag, (x, y) in zip(lags[:2], (across, down), strict=True) if lag]
        apart.append(1.0 - sum(_at(table, x) * _at(table, y) for x, y in each) / (len(each) * float(table[0]) ** 2))
    return 1.0 - apart[0] / apart[1]


def _at(table: Doubles, apart_px: float) -> float:
    at = min(abs(apart_px) * FINE, len(table) - 2.0)
    i = int(at)
    here, after = table[i : i + 2].tolist()
    return float(here + (at - i) * (after - here))


@cache
def _interpolated(blur_px: float, linear: bool) -> Doubles:
    """Covariance of two samples so many FINEths of a pixel apart, along a row, of white noise that was blurred.

    The mean over all places between pixels: the autocorrelation of the interpolation's kernel and the blur's.
    """
    x = np.arange(-REACH * FINE, REACH * FINE + 1) / FINE
    kernel = np.maximum(0.0, 1.0 - np.abs(x)) if linear else np.sinc(x) * np.sinc(x / REACH)
    of_kernel = np.correlate(kernel, kernel, "full") / FINE
    taps = np.exp(-0.5 * (np.arange(-REACH, REACH + 1) / blur_px) ** 2) if blur_px > 0 else np.ones(1)
    of_blur = np.correlate(taps, taps, "full") / taps.sum() ** 2
    spread = np.zeros((len(of_blur) - 1) * FINE + 1)
    spread[::FINE] = of_blur
    both = np.convolve(of_kernel, spread)
    return np.asarray(both[len(both) // 2 :])


@lru_cache(maxsize=256)
def of_lattice(
    k: int, lags: Lags, across: Step, down: Step, fitted: int, linear: bool
) -> tuple[float, float, float] | None:
    """How much r₀ is above what interpolation makes it, g, and the share of a cell's samples that the fit leaves.

    None where it leaves none.
    """
    j, i = np.mgrid[:k, :k]
    row = i * across[1] + j * down[1]
    row = (row - row.mean()) / max(float(np.ptp(row)), 1e-6)
    functions, sizes, _ = np.linalg.svd(np.vander(row.reshape(-1), fitted, increasing=True), full_matrices=False)
    basis = functions[:, sizes**2 > RIDGE * np.square(sizes).mean()]
    free = 1.0 - basis.shape[1] / (k * k)
    if free <= 0 or not any(lags[:2]):
        return None
    white, variance = _left_of(_covariance(k, across, down, 0.0, linear), basis, lags)
    lags_px = [lag * math.hypot(*step) for lag, step in zip(lags[:2], (across, down), strict=True) if lag]
    blur_px = round(BLUR * sum(lags_px) / len(lags_px) / ROUNDED_PX) * ROUNDED_PX
    blurred, less = _left_of(_covariance(k, across, down, blur_px, linear), basis, lags)
    growth = math.log(variance / less) / (blurred - white) if blurred > white else math.inf
    return white - likeness(across, down, lags, linear), growth, free


def _covariance(k: int, across: Step, down: Step, blur_px: float, linear: bool) -> Doubles:
    """(2k − 1, 2k − 1): of samples so many apart down the lattice, and across it; k − 1 is none."""
    j, i = np.mgrid[1 - k : k, 1 - k : k]
    table = _interpolated(blur_px, linear)
    places = np.arange(len(table)) / FINE
    x, y = np.abs(i * across[0] + j * down[0]), np.abs(i * across[1] + j * down[1])
    return np.asarray(np.interp(x, places, table) * np.interp(y, places, table))


def _left_of(covariance: Doubles, basis: Doubles, lags: Lags) -> tuple[float, float]:
    """Of noise with this covariance, what is left in a cell without an orthonormal basis (points, functions).

    r, and the mean square.
    """
    k = (len(covariance) + 1) // 2
    here = k - 1
    of_basis = covariance.reshape(-1)[_differences(k)] @ basis
    taken = of_basis - 0.5 * basis @ (basis.T @ of_basis)  # M R M = R − basis·takenᵀ − taken·basisᵀ
    b, t = basis.reshape(k, k, -1), taken.reshape(k, k, -1)
    square = covariance[here, here] - 2.0 * (b * t).sum(axis=2)
    inner, rest = slice(lags.rim, k - lags.rim), k - 2 * lags.rim
    seen = b[inner, inner], t[inner, inner], square[inner, inner]
    apart = []
    for times in (1, 2):
        total = 0.0
        for axis, lag, together in ((1, lags.aside, covariance[here]), (0, lags.below, covariance[:, here])):
            if not lag:
                continue
            one, other = slice(None, rest - times * lag), slice(times * lag, None)
            bb, tt, ss = (np.moveaxis(of, axis, 0) for of in seen)
            product = rest * (rest - times * lag) * together[here + times * lag]
            product -= (bb[one] * tt[other] + tt[one] * bb[other]).sum()
            total += float(ss[one].sum() + ss[other].sum() - 2.0 * product)
        apart.append(total / pairs(k, lags, times))
    return 1.0 - apart[0] / apart[1], float(square.mean())


@cache
def _differences(k: int) -> NDArray[np.intp]:
    """(k·k, k·k): where in `_covariance` that of each two of a cell's points is."""
    j, i = (of.reshape(-1) for of in np.mgrid[:k, :k])
    return np.asarray((j - j[:, None] + k - 1) * (2 * k - 1) + (i - i[:, None] + k - 1))
