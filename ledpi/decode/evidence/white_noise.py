"""White noise after a fit: how alike that makes samples next to each other, and how a blur changes it.

`noise` says why. Nothing here is of a picture: it all follows from how a cell's samples are interpolated, and from what
is fitted to them.
"""

from __future__ import annotations

import math
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ledpi.core.records import Floats

Indices = NDArray[np.intp]
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


@cache
def pair_count(k: int, lags: Lags, times: int) -> int:
    """Counts those of a cell's samples that are so many lags apart, aside or below."""
    inner = k - 2 * lags.rim
    return sum(inner * (inner - times * lag) for lag in (lags.aside, lags.below) if lag)


def likeness(across: Step, down: Step, lags: Lags, linear: bool) -> float:
    """r of white noise, by interpolation alone."""
    table = _table(linear)
    once = twice = 0.0  # mean squares of differences, a lag and two lags apart
    for lag, (x, y) in ((lags.aside, across), (lags.below, down)):
        if lag:
            once += table[0] ** 2 - _interpolate(table, lag * x) * _interpolate(table, lag * y)
            twice += table[0] ** 2 - _interpolate(table, 2 * lag * x) * _interpolate(table, 2 * lag * y)
    return 1.0 - once / twice


@cache
def _table(linear: bool) -> list[float]:
    """`_interpolated` without blur, for one number at a time."""
    table: list[float] = _interpolated(0.0, linear).tolist()
    return table


def _interpolate(table: list[float], apart_px: float) -> float:
    at = min(abs(apart_px) * FINE, len(table) - 2.0)
    i = int(at)
    return table[i] + (at - i) * (table[i + 1] - table[i])


@cache
def _interpolated(blur_px: float, linear: bool) -> Floats:
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


@lru_cache(maxsize=1024)
def lattice_statistics(
    k: int, lags: Lags, across: Step, down: Step, fitted: int, linear: bool
) -> tuple[float, float, float] | None:
    """Returns by how much r₀ exceeds that of interpolation, g, and the share of a cell's samples that the fit leaves.

    None where it leaves none.
    """
    basis = _fitted(k, across[1], down[1], fitted)
    free = 1.0 - basis.shape[1] / (k * k)
    if free <= 0 or not any(lags[:2]):
        return None
    white, variance = _residual_statistics(_covariance(k, across, down, 0.0, linear), basis, lags)
    lags_px = [lag * math.hypot(*step) for lag, step in zip(lags[:2], (across, down), strict=True) if lag]
    blur_px = round(BLUR * sum(lags_px) / len(lags_px) / ROUNDED_PX) * ROUNDED_PX
    blurred, less = _residual_statistics(_covariance(k, across, down, blur_px, linear), basis, lags)
    growth = math.log(variance / less) / (blurred - white) if blurred > white else math.inf
    return white - likeness(across, down, lags, linear), growth, free


def _fitted(k: int, aside_px: float, below_px: float, count: int) -> Floats:
    """(k·k, at most `count`) orthonormal: polynomials of the picture's row, which changes by so much from sample to
    sample, as far as a cell tells them apart."""
    samples = np.arange(k) - 0.5 * (k - 1)
    row = np.add.outer(samples * below_px, samples * aside_px).reshape(-1)
    powers = np.vander(row / max(2.0 * float(row.max()), 1e-6), count, increasing=True)
    sizes, directions = np.linalg.eigh(powers.T @ powers)
    significant = sizes > RIDGE * sizes.mean()
    return np.asarray(powers @ (directions[:, significant] / np.sqrt(sizes[significant])))


def _covariance(k: int, across: Step, down: Step, blur_px: float, linear: bool) -> Floats:
    """(k·k, k·k) of a cell's samples."""
    table, apart = _interpolated(blur_px, linear), np.arange(1 - k, k)
    places = np.arange(len(table)) / FINE
    x, y = (np.abs(np.add.outer(apart * below, apart * aside)) for below, aside in zip(down, across, strict=True))
    return np.asarray((np.interp(x, places, table) * np.interp(y, places, table)).take(_differences(k)))


def _residual_statistics(covariance: Floats, basis: Floats, lags: Lags) -> tuple[float, float]:
    """Returns, for noise of covariance R, what a cell has left without an orthonormal basis F: r, and the mean square.

    What is left is M R M, M = 1 − F·Fᵀ. Two samples differ by the square of what they differ by themselves, less twice
    F·(R·F)ᵀ, and F·(Fᵀ·R·F)·Fᵀ.
    """
    k = math.isqrt(len(covariance))
    of_basis = covariance @ basis
    shared = basis.T @ of_basis
    apart = []
    for times in (1, 2):
        one, other = _sample_pairs(k, lags, times)
        step, of_step = basis[one] - basis[other], of_basis[one] - of_basis[other]
        themselves = 2.0 * (len(one) * covariance[0, 0] - covariance[one, other].sum())
        apart.append((themselves - 2.0 * (step * of_step).sum() + ((step @ shared) * step).sum()) / len(one))
    return float(1.0 - apart[0] / apart[1]), float((covariance.trace() - shared.trace()) / (k * k))


@cache
def _sample_pairs(k: int, lags: Lags, times: int) -> tuple[Indices, Indices]:
    """Which two samples of a cell are compared: `pair_count` of them."""
    at = np.arange(k * k).reshape(k, k)[lags.rim : k - lags.rim, lags.rim : k - lags.rim]
    inner, across, down = len(at), times * lags.aside, times * lags.below
    both = []
    if across:
        both.append((at[:, : inner - across], at[:, across:]))
    if down:
        both.append((at[: inner - down], at[down:]))
    one, other = (np.concatenate([each.reshape(-1) for each in of]) for of in zip(*both, strict=True))
    return one, other


@cache
def _differences(k: int) -> Indices:
    """(k·k, k·k): where that of each two of a cell's points is, of how many they are apart: (2k − 1, 2k − 1)."""
    j, i = (of.reshape(-1) for of in np.mgrid[:k, :k])
    return np.asarray((j - j[:, None] + k - 1) * (2 * k - 1) + (i - i[:, None] + k - 1))
