"""The waves of bands (waves.c); the form of evidence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ledpi.core.records import Floats, Singles
from ledpi.kernels.library import lib, pointer


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
    given, cosines = pointer(rows), pointer(out)
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
    into = pointer(out)
    lib.ledpi_square_waves(
        *(pointer(rows), rows.size, cycles_a_row, start_cycles, averaged, apart, exposure_cycles, duty, fundamental),
        *(into, into + rows.size),
    )
    return out
