"""`fitted` of `panel_fit` in numpy: what the compiled loop (kernels/panel_fit.c) is held to, and is used without it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ledpi.decode.corners.adjust import NO_RIM_WALL_PX
from ledpi.decode.corners.sides import Points, Sides, as_corners, as_points
from ledpi.decode.striped.numpy_panel_model import (
    BLUR,
    GAIN,
    GAP,
    LONGER,
    PHASE,
    RIM,
    WAYS,
    Blinking,
    Model,
    course,
)
from ledpi.geometry import apply_homography, distort, square_box, undistort, unit_square_to
from ledpi.records import Floats, Intrinsics, Mask, Singles

FLOOR = 0.1  # of full light: what weighs as much as the noise of what is dark
OUTSIDE = 1.0  # and what texture outside weighs
MOST_STEP = 0.1  # of half the side, that a homography changes at once
SETTLED = 1e-3  # less than that, and it is done
LEAST_GAIN = 0.02  # of the mean
LEAST_BLUR_PX, MOST_BLUR_PX, MOST_GAP = 0.4, 3.0, 0.3
MOST_LONGER, MOST_SMOOTHER = 0.5, 2.0
ENDS = square_box(-1.0, 1.0)


def fit_panel(
    light: Singles,
    first: complex,
    shrink: int,
    lens: Intrinsics | None,
    cells: int,
    white: Mask,
    waves: Singles,
    cycles_a_row: Floats,
    levels: tuple[float, float, float],
    along: Floats,
    pitch_px: Floats,
    rounds: int,
    prior: Floats,
    corners: Points,
    unknown: Floats,
) -> tuple[float, float, float] | None:
    """As `kernels.panel_fit.fit_panel`."""
    panel = _Seen(light, first, shrink, lens, cells, white, waves, cycles_a_row, levels, along, pitch_px, prior)
    if lens is not None:  # before it bends it a panel is a square
        corners[:] = as_points(undistort(as_corners(corners), lens))
    for round_number in range(rounds):
        homography = unit_square_to(as_corners(corners))
        found = panel.equations(homography, unknown)
        if found is None:
            return None
        matrix, right, explained = found
        step = np.asarray(np.linalg.solve(matrix, right), np.float64)
        most = _take_step(step, homography, corners, unknown)
        if round_number > 0 and most < SETTLED:  # the first is with usual gains
            break
    rim, undone = float(unknown[RIM]), 0.0
    if rim * float(pitch_px.min()) * shrink < NO_RIM_WALL_PX:
        _close_rim(matrix, corners, unknown)
        rim, undone = 0.0, rim
    rim_share = 1 - 2 * rim / cells
    corners[:] = _moved(unit_square_to(as_corners(corners)), np.zeros(WAYS), rim_share)
    sigma, size_sigma = _deviations(matrix, homography, rim_share, cells, undone)
    if lens is None:
        return explained, sigma, size_sigma
    corners[:] = as_points(distort(as_corners(corners), lens))
    return explained, sigma * lens.fx, size_sigma * lens.fx


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """What is fitted, as `fit_panel` is given it."""

    light: Singles
    first: complex
    shrink: int
    lens: Intrinsics | None
    cells: int
    white: Mask
    waves: Singles
    cycles_a_row: Floats
    levels: tuple[float, float, float]
    along: Floats
    pitch_px: Floats
    prior: Floats

    def equations(self, homography: Floats, unknown: Floats) -> tuple[Floats, Floats, float] | None:
        """The normal equations' matrix and right side there, and the share of the light's squares that is explained."""
        dark, bright, saturated = self.levels
        u, v = (w.reshape(-1) for w in np.meshgrid(self.along / self.cells, self.along / self.cells))
        seen_at = apply_homography(homography, np.stack([u, v], axis=1))
        pixels = seen_at if self.lens is None else distort(seen_at, self.lens)
        seen, inside = _light_at(self.light, (pixels - (self.first.real, self.first.imag)) / self.shrink)
        used = inside & (seen < saturated)
        blurs = (math.exp(unknown[BLUR]) / self.pitch_px).tolist()
        across, down = (course(self.along, self.cells, blur, unknown[GAP], unknown[RIM]) for blur in blurs)
        phases = unknown[PHASE : PHASE + 2, None] + pixels[:, 1] * self.cycles_a_row[:, None]
        model = Model.of(unknown, across, down, self.white, _blinking(self.waves, phases, unknown), u, v)
        weight = used / np.sqrt(np.maximum(model.light, 0.0) + FLOOR + OUTSIDE * model.outside)
        shares = (seen - dark) / (bright - dark)
        left, above_dark = weight * (shares - model.light), weight * (shares - unknown[-1])
        explained = 1 - float(left @ left) / max(float(above_dark @ above_dark), 1e-9)
        samples = int(used.sum())
        matrix, right = _normal_equations(model.slopes * weight, left, samples, self.prior, unknown)
        return (matrix, right, explained) if samples > len(matrix) and np.isfinite(matrix).all() else None


def _take_step(step: Floats, homography: Floats, corners: Points, unknown: Floats) -> float:
    """Moves corners and unknowns by it, or in its direction; returns how much it would have changed the homography."""
    most = float(np.abs(step[:WAYS]).max())
    step = step * min(1.0, MOST_STEP / max(most, 1e-12))
    corners[:] = _moved(homography, step[:WAYS], 1.0)
    unknown[WAYS:] += step[WAYS:]
    _limit(unknown)
    return most


def _normal_equations(
    slopes: Floats, left: Floats, samples: int, prior: Floats, unknown: Floats
) -> tuple[Floats, Floats]:
    """The matrix and the right side, of slopes (U, P) and what is `left` (P,), with what is known beforehand."""
    variance = max(float(left @ left) / max(samples, 1), 1e-9)
    matrix, right = slopes @ slopes.T / variance, slopes @ left / variance
    matrix[np.diag_indices(len(matrix))] *= 1 + 1e-6
    matrix[np.diag_indices(len(matrix))] += 1e-6 + prior[1]
    right += prior[1] * np.where(np.arange(len(right)) < WAYS, 0.0, prior[0] - unknown)
    return matrix, right


def _limit(unknown: Floats) -> None:
    """Keeps within what panels and bands may be."""
    unknown[GAIN:-1] = np.maximum(unknown[GAIN:-1], LEAST_GAIN * unknown[GAIN:-1].mean())
    unknown[BLUR] = np.clip(unknown[BLUR], math.log(LEAST_BLUR_PX), math.log(MOST_BLUR_PX))
    unknown[GAP] = np.clip(unknown[GAP], 0.0, MOST_GAP)
    unknown[RIM] = np.clip(unknown[RIM], -0.5 * MOST_GAP, 0.5 * MOST_GAP)
    most_shaped = np.array([MOST_LONGER, MOST_SMOOTHER])
    unknown[LONGER:PHASE] = np.clip(unknown[LONGER:PHASE], -most_shaped, most_shaped)


def _light_at(light: Singles, at: Floats) -> tuple[Floats, Mask]:
    """Between the pixels of a window, at points (P, 2), and which are in it."""
    height, width = light.shape
    inside = np.asarray((at >= 0).all(axis=1) & (at <= (width - 1, height - 1)).all(axis=1))
    x, y = np.where(inside[:, None], at, 0.0).astype(np.float32).T
    column, row = np.minimum(x.astype(np.int64), width - 2), np.minimum(y.astype(np.int64), height - 2)
    right, down = x - column, y - row
    upper, lower = ((1 - right) * light[r, column] + right * light[r, column + 1] for r in (row, row + 1))
    return np.asarray((1 - down) * upper + down * lower, np.float64), inside


def _blinking(waves: Singles, cycles: Floats, unknown: Floats) -> Blinking:
    """What either class shows after so many cycles (2, P)."""
    tables = waves.reshape(-1, 2, waves.shape[-1])
    shown, later = _waves_at(tables[0], cycles)
    shapes = np.zeros((2, *shown.shape))
    for s, table in enumerate(tables[1:]):
        shapes[s], of_slope = _waves_at(table, cycles)
        shown, later = shown + unknown[LONGER + s] * shapes[s], later + unknown[LONGER + s] * of_slope
    return Blinking(shown, later, shapes)


def _waves_at(tables: Singles, cycles: Floats) -> tuple[Floats, Floats]:
    """(2, P) each: what either class shows, and how that changes by a cycle; from tables (2, steps) of a period."""
    steps = tables.shape[1]
    at = (cycles - np.floor(cycles)) * steps
    step = np.minimum(at.astype(np.int64), steps - 1)
    classes = np.arange(2)[:, None]
    here, after = tables[classes, step].astype(np.float64), tables[classes, (step + 1) % steps]
    return here + (at - step) * (after - here), (after - here) * steps


def _moved(homography: Floats, ways: Floats, rim_share: float) -> Points:
    """The corners (4,) after the homography has been wrong by these ways (8,).

    Those of a rim that is so many times as large as the lattice.
    """
    p, q = rim_share * ENDS.T
    both = ways[6] * p + ways[7] * q
    u = 0.5 * (p - ways[0] - ways[1] * p - ways[2] * q - p * both + 1)
    v = 0.5 * (q - ways[3] - ways[4] * p - ways[5] * q - q * both + 1)
    return as_points(apply_homography(homography, np.stack([u, v], axis=1)))


def _close_rim(matrix: Floats, corners: Points, unknown: Floats) -> None:
    """Takes the rim to where the lattice ends, and all else to where it is likeliest then.

    By what is known of all unknowns (`matrix`).
    """
    column = np.linalg.inv(matrix)[RIM]
    change = -unknown[RIM] / column[RIM] * column
    unknown[WAYS:] += change[WAYS:]
    unknown[RIM] = 0.0
    corners[:] = _moved(unit_square_to(as_corners(corners)), change[:WAYS], 1.0)


def _deviations(
    matrix: Floats, homography: Floats, rim_share: float, cells: int, undone: float
) -> tuple[float, float]:
    """Of the corners' coordinates, if the rim is where it is taken to be; and of how far all sides move outward alike.

    By what is known of all unknowns (`matrix`). Where `undone` is not 0, the rim was that far within the lattice's end,
    and has been taken there: it is anywhere between.
    """
    little, here = 1e-4, _moved(homography, np.zeros(WAYS), rim_share)
    moved = [_moved(homography, way, rim_share) for way in little * np.eye(WAYS)]
    moved.append(_moved(homography, np.zeros(WAYS), rim_share - 2 * little / cells))
    by_way = (np.array(moved) - here) / little  # (9, 4), the last by the rim
    of = [*range(WAYS), RIM]
    covariance = np.linalg.inv(matrix)[np.ix_(of, of)]
    given = covariance - np.outer(covariance[-1], covariance[-1]) / covariance[-1, -1]
    coordinates = as_corners(by_way).reshape(WAYS + 1, -1)
    inward = Sides.of(here[None]).inward[0]
    outward = -(by_way * (inward + np.roll(inward, 1)).conj()).real.sum(axis=1) / 8
    variance = float(((given[:-1, :-1] @ coordinates[:-1]) * coordinates[:-1]).sum()) / 8
    shared, of_rim = float(outward @ covariance[-1]), float(covariance[-1, -1])
    size_variance = float(outward @ covariance @ outward)
    if undone != 0.0:
        size_variance += shared**2 / of_rim * (undone**2 / of_rim / 3 - 1)
    return math.sqrt(variance), math.sqrt(size_variance)
