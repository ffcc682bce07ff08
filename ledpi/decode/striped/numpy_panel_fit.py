"""`fitted` of `panel_fit` in numpy: what the compiled loop (kernels/panel_fit.c) is held to, and is used without it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ledpi.decode.corners.adjust import NO_RIM_WALL_PX
from ledpi.decode.corners.sides import Points, Sides, as_corners, as_points
from ledpi.geometry import apply_homography, distort, square_box, undistort, unit_square_to
from ledpi.records import Floats, Intrinsics, Mask, Singles

WAYS, BLUR, GAP, LONGER, PHASE, SPOT, BESIDE, RIM, GAIN = 8, 8, 9, 10, 12, 14, 16, 20, 21
SPOT_SIGMA = np.array([0.16, 0.32])  # of the pitch: of which a cell's light is made up
FLOOR = 0.1  # of full light: what weighs as much as the noise of what is dark
OUTSIDE = 1.0  # and what texture outside weighs
MOST_STEP = 0.1  # of half the side, that a homography changes at once
SETTLED = 1e-3  # less than that, and it is done
LEAST_GAIN = 0.02  # of the mean
LEAST_BLUR_PX, MOST_BLUR_PX, MOST_GAP = 0.4, 3.0, 0.3
MOST_LONGER, MOST_SMOOTHER = 0.5, 2.0
ENDS = square_box(-1.0, 1.0)
_erf = np.vectorize(math.erf, otypes=[np.float64])


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
    dark, bright, saturated = levels
    u, v = (w.reshape(-1) for w in np.meshgrid(along / cells, along / cells))
    explained = 0.0
    if lens is not None:  # before it bends it a panel is a square
        corners[:] = as_points(undistort(as_corners(corners), lens))
    for round_number in range(rounds):
        homography = unit_square_to(as_corners(corners))
        seen_at = apply_homography(homography, np.stack([u, v], axis=1))
        pixels = seen_at if lens is None else distort(seen_at, lens)
        seen, inside = _light_at(light, (pixels - (first.real, first.imag)) / shrink)
        used = inside & (seen < saturated)
        blurs = (math.exp(unknown[BLUR]) / pitch_px).tolist()
        courses = [_course(along, cells, blur, unknown[GAP], unknown[RIM]) for blur in blurs]
        phases = unknown[PHASE : PHASE + 2, None] + pixels[:, 1] * cycles_a_row[:, None]
        model, slopes, outside = _model(unknown, courses, white, *_shown(waves, phases, unknown), u, v)
        weight = used / np.sqrt(np.maximum(model, 0.0) + FLOOR + OUTSIDE * outside)
        shares = (seen - dark) / (bright - dark)
        left, above_dark = weight * (shares - model), weight * (shares - unknown[-1])
        explained = 1 - float(left @ left) / max(float(above_dark @ above_dark), 1e-9)
        samples = int(used.sum())
        matrix, right = _normal_equations(slopes * weight, left, samples, prior, unknown)
        if samples <= len(matrix) or not np.isfinite(matrix).all():
            return None
        step = np.asarray(np.linalg.solve(matrix, right), np.float64)
        most = float(np.abs(step[:WAYS]).max())
        step *= min(1.0, MOST_STEP / max(most, 1e-12))
        corners[:] = _moved(homography, step[:WAYS], 1.0)
        unknown[WAYS:] += step[WAYS:]
        _limit(unknown)
        if (round_number > 0 and most < SETTLED) or round_number == rounds - 1:  # the first is with usual gains
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


def _shown(waves: Singles, cycles: Floats, unknown: Floats) -> tuple[Floats, Floats, Floats]:
    """(2, P), (2, P), (2, 2, P): what either class shows, and how that changes by a cycle, and by its shapes."""
    tables = waves.reshape(-1, 2, waves.shape[-1])
    shown, later = _waves_at(tables[0], cycles)
    shapes = np.zeros((2, *shown.shape))
    for s, table in enumerate(tables[1:]):
        shapes[s], of_slope = _waves_at(table, cycles)
        shown, later = shown + unknown[LONGER + s] * shapes[s], later + unknown[LONGER + s] * of_slope
    return shown, later, shapes


def _waves_at(tables: Singles, cycles: Floats) -> tuple[Floats, Floats]:
    """(2, P) each: what either class shows, and how that changes by a cycle; from tables (2, steps) of a period."""
    steps = tables.shape[1]
    at = (cycles - np.floor(cycles)) * steps
    step = np.minimum(at.astype(np.int64), steps - 1)
    classes = np.arange(2)[:, None]
    here, after = tables[classes, step].astype(np.float64), tables[classes, (step + 1) % steps]
    return here + (at - step) * (after - here), (after - here) * steps


@dataclass(frozen=True, slots=True, eq=False)
class _Course:
    """Of P places along the grid, for each of n cells: their light and how that changes; (n, P), spots (n, S, P)."""

    light: Floats
    slope: Floats  # with the place
    blurred: Floats  # with the blur's logarithm
    gapped: Floats  # with the gap
    rimmed: Floats  # with how far further in the rim is
    spot: Floats
    steep: Floats  # of spots, with the place
    wider: Floats  # and with the blur's logarithm
    beside: Floats  # (2, P) share of what is before the first cell, and after the last
    falls: Floats  # (2, P) its slope


def _course(along: Floats, cells: int, sigma: float, gap: float, rim: float) -> _Course:
    cell = np.arange(cells)[:, None]
    before, after = 0.5 * (cell > 0), 0.5 * (cell < cells - 1)  # of the gap: none at the rim
    first, last = cell == 0, cell == cells - 1
    from_first = (along - cell - gap * before - rim * first) / sigma
    from_last = (along - cell - 1 + gap * after + rim * last) / sigma
    up, down = (np.exp(-0.5 * z * z) / math.sqrt(2 * math.pi) for z in (from_first, from_last))
    near = np.clip(np.floor(along), 0, cells - 1)
    other = near + np.where(along - near > 0.5, 1, -1)
    of_these = (cell == near) | (cell == other)  # no light reaches further
    off = along - cell - 0.5
    beyond = (np.stack([-along, along - cells]) + rim) / sigma
    spot_sigma = np.hypot(SPOT_SIGMA, sigma)[:, None]  # as the lens blurs them
    z = np.clip(off, -0.5, 0.5)[:, None] / spot_sigma
    spot = np.exp(-0.5 * z * z)
    return _Course(
        light=of_these * 0.5 * (_erf(from_first / math.sqrt(2)) - _erf(from_last / math.sqrt(2))),
        slope=of_these * (up - down) / sigma,
        blurred=of_these * (from_last * down - from_first * up),
        gapped=of_these * -(up * before + down * after) / sigma,
        rimmed=of_these * -(up * first + down * last) / sigma,
        spot=spot,
        beside=0.5 * (1 + _erf(beyond / math.sqrt(2))),
        falls=np.array([[-1.0], [1.0]]) * np.exp(-0.5 * beyond * beyond) / math.sqrt(2 * math.pi) / sigma,
        steep=np.where(np.abs(off)[:, None] <= 0.5, -z / spot_sigma * spot, 0.0),
        wider=np.square(z * sigma / spot_sigma) * spot,
    )


def _model(
    unknown: Floats,
    courses: list[_Course],
    white: Mask,
    shown: Floats,
    later: Floats,
    shapes: Floats,
    u: Floats,
    v: Floats,
) -> tuple[Floats, Floats, Floats]:
    """(P,) the light of the panel's picture, (unknowns, P) how it changes with each of them, (P,) what lies outside."""
    across, down = courses
    cells, both = len(across.light), _at_crossings
    slopes = np.zeros((len(unknown), len(u)))
    by_place = np.zeros((2, len(u)))
    model = np.full(len(u), unknown[-1])
    for cell, own in enumerate(white.reshape(-1).astype(int).tolist()):
        row, column = divmod(cell, cells)
        light = both(across.light[column], down.light[row])
        lit = (light >= 1e-4) * unknown[GAIN + cell] * shown[own]
        spots = [both(across.spot[column, s], down.spot[row, s]) for s in range(len(SPOT_SIGMA))]
        shape = 1 + sum(b * spot for b, spot in zip(unknown[SPOT:BESIDE], spots, strict=True))
        tilt = [
            sum(b * both(across.steep[column, s], down.spot[row, s]) for s, b in enumerate(unknown[SPOT:BESIDE])),
            sum(b * both(across.spot[column, s], down.steep[row, s]) for s, b in enumerate(unknown[SPOT:BESIDE])),
        ]
        model += lit * light * shape
        by_place[0] += lit * (both(across.slope[column], down.light[row]) * shape + light * tilt[0])
        by_place[1] += lit * (both(across.light[column], down.slope[row]) * shape + light * tilt[1])
        for k, part in ((BLUR, "blurred"), (GAP, "gapped"), (RIM, "rimmed")):
            of_part = both(getattr(across, part)[column], down.light[row])
            slopes[k] += lit * shape * (of_part + both(across.light[column], getattr(down, part)[row]))
        slopes[PHASE + own] += (light >= 1e-4) * unknown[GAIN + cell] * light * shape * later[own]
        slopes[LONGER:PHASE] += (light >= 1e-4) * unknown[GAIN + cell] * light * shape * shapes[:, own]
        for s, spot in enumerate(spots):
            slopes[SPOT + s] += lit * light * spot
            wider = both(across.wider[column, s], down.spot[row, s]) + both(across.spot[column, s], down.wider[row, s])
            slopes[BLUR] += lit * light * unknown[SPOT + s] * wider
        slopes[GAIN + cell] = (light >= 1e-4) * light * shape * shown[own]
    slopes[-1] = 1.0
    _add_beside(unknown, across, down, slopes, by_place)
    beside = slopes[BESIDE:RIM]
    model += unknown[BESIDE:RIM] @ beside
    p, q = 2 * u - 1, 2 * v - 1
    along_u, along_v = by_place * (0.5 * cells)
    turned = p * along_u + q * along_v
    slopes[:WAYS] = [along_u, p * along_u, q * along_u, along_v, p * along_v, q * along_v, p * turned, q * turned]
    return model, slopes, beside.sum(axis=0)


def _at_crossings(of_column: Floats, of_row: Floats) -> Floats:
    """(P,) what is of a column's places times what is of a row's, on the whole grid."""
    product: Floats = (of_row[:, None] * of_column).reshape(-1)
    return product


def _add_beside(unknown: Floats, across: _Course, down: _Course, slopes: Floats, by_place: Floats) -> None:
    """What lies beside the panel, left, right, above and below: of a corner either at the left or at the right only."""
    within, narrower = 1 - across.beside.sum(axis=0), -across.falls.sum(axis=0)
    nearer = np.array([[-1.0], [1.0]])  # with the rim, of what is beside
    by_rim = -(nearer * across.falls).sum(axis=0)
    everywhere = np.ones_like(within)
    for k in range(2):
        slopes[BESIDE + k] = _at_crossings(across.beside[k], everywhere)
        slopes[BESIDE + 2 + k] = _at_crossings(within, down.beside[k])
        by_place[0] += unknown[BESIDE + k] * _at_crossings(across.falls[k], everywhere)
        by_place[0] += unknown[BESIDE + 2 + k] * _at_crossings(narrower, down.beside[k])
        by_place[1] += unknown[BESIDE + 2 + k] * _at_crossings(within, down.falls[k])
        slopes[RIM] += unknown[BESIDE + k] * _at_crossings(nearer[k] * across.falls[k], everywhere)
        slopes[RIM] += unknown[BESIDE + 2 + k] * _at_crossings(within, nearer[k] * down.falls[k])
        slopes[RIM] += unknown[BESIDE + 2 + k] * _at_crossings(by_rim, down.beside[k])


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
