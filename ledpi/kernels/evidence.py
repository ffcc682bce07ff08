"""What pictures say of the bands in a panel's cells (waves.c, single_frame.c, comparison.c)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ledpi.kernels.library import at, ffi, lib
from ledpi.records import Floats, Integers, Mask, Singles


class Weighed(NamedTuple):
    """Evidence of one fit, and what that has left of the light."""

    score: Floats  # (cells, P)
    information: Floats  # (cells, P, cells, P)
    free: float  # samples, less what is fitted
    near: float  # sum of the squared differences of samples of a cell a lag apart
    far: float  # and of those two lags apart


def waves(rows: Singles, waves_hz: Sequence[float], row_time_us: float, since_s: float) -> Singles:
    """(2·waves, …): cosine and sine of each wave in these picture rows (…), `since_s` from the origin to row 0."""
    rows = np.ascontiguousarray(rows)
    out = np.empty((2 * len(waves_hz), *rows.shape), np.float32)
    given, cosines = at(rows), at(out)
    for hz in waves_hz:
        start = math.fmod(hz * since_s, 1.0)
        lib.ledpi_waves(given, rows.size, hz * row_time_us * 1e-6, start, cosines, cosines + rows.size)
        cosines += 2 * rows.size
    return out


def square_waves(
    rows: Singles,
    *,
    cycles_a_row: float,
    start_cycles: float,
    averaged: int,
    apart: float,
    exposure_cycles: float,
    duty: float,
    fundamental: float,
) -> Singles:
    """(2, …): `shutter.square_wave_bands` in these rows (…), meaned over `averaged` rows around each, so far `apart`.

    `start_cycles` is the fundamental's phase in row 0, `fundamental` its amplitude, with its sign.
    """
    rows = np.ascontiguousarray(rows)
    out = np.empty((2, *rows.shape), np.float32)
    into = at(out)
    lib.ledpi_square_waves(
        *(at(rows), rows.size, cycles_a_row, start_cycles, averaged, apart, exposure_cycles, duty, fundamental),
        *(into, into + rows.size),
    )
    return out


def correlation(expected: Sequence[float], near: float, far: float, free: float) -> list[float]:
    """Excess, deviation and growth of a `Correlation`; `expected` as `Expected`, both of decode/evidence/noise.py."""
    of = np.empty(3)
    lib.ledpi_correlation(ffi.new("Expected *", expected), [free, near, far], at(of))
    return of.tolist()


def volume(excess: float, deviation: float, growth: float) -> float:
    """By how much evidence claims too much, where noise is as alike as that."""
    times: float = lib.ledpi_volume(excess, deviation, growth)
    return times


def single_evidence(
    *,
    light: Singles,
    valid: Mask | None,
    waves: Singles,
    along: Singles,
    column: Integers,
    first: Integers,
    met: Integers,
    shown: Singles | None,
    of_class: Singles | None,
    white: Mask | None,
    independence: float,
    lags: tuple[int, int, int],
) -> Weighed | None:
    """What there is of evidence; None where nothing fits.

    `light`, `valid`, `shown` (cells, points), `waves` (P, cells, points), `of_class` (2, cells, points), `white`
    (cells,); `along` is the lattice's; `column`, `first` and `met` say what lights up each point. `lags`: how many
    samples aside, and below, for `near` (0: not that way), and how many at a cell's rim are left out.
    """
    cells, points = light.shape
    parameters = len(waves)
    light, waves = np.ascontiguousarray(light), np.ascontiguousarray(waves)
    score, numbers = np.empty((cells, parameters)), np.empty(3)
    information = np.empty((cells, parameters, cells, parameters))
    fits = lib.ledpi_single_evidence(
        *(math.isqrt(cells), math.isqrt(points), parameters, at(light), at(valid), at(waves)),
        *(at(along), len(column), at(column), at(first), at(met)),
        *(at(shown), at(of_class), at(white), independence, *lags),
        *(at(score), at(information), at(numbers)),
    )
    return Weighed(score, information, *numbers.tolist()) if fits else None


def compared_evidence(
    *,
    light: Singles,
    valid: Mask | None,
    waves: Singles,
    picture: Singles,
    count: Singles,
    mean_waves: Singles,
    along: Singles,
    independence: float,
    lags: tuple[int, int, int],
) -> tuple[float, Weighed | None]:
    """The light's scale; and, as of `single_evidence`, what there is of evidence, None where nothing fits.

    `light`, `valid`, `picture`, `count` (cells, points), `waves`, `mean_waves` (P, cells, points); `along` is the
    lattice's.
    """
    (cells, points), parameters = light.shape, len(waves)
    score, numbers = np.empty((cells, parameters)), np.empty(4)
    information = np.empty((cells, parameters, cells, parameters))
    given = [np.ascontiguousarray(array) for array in (waves, picture, count, mean_waves)]
    fits = lib.ledpi_compared_evidence(
        *(math.isqrt(cells), math.isqrt(points), parameters, at(light), at(valid)),
        *(*(at(array) for array in given), at(along), independence, *lags),
        *(at(score), at(information), at(numbers)),
    )
    scale, *rest = numbers.tolist()
    return scale, Weighed(score, information, *rest) if fits else None
