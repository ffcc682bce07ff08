"""The light of a panel's picture, and how it changes with all that is unknown of it: what `numpy_panel_fit` fits."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ledpi.records import Floats, Mask

# The unknowns, in this order: a homography's eight ways to be wrong, and where each of the others begins.
WAYS, BLUR, GAP, LONGER, PHASE, SPOT, BESIDE, RIM, GAIN = 8, 8, 9, 10, 12, 14, 16, 20, 21
SPOT_SIGMA = np.array([0.16, 0.32])  # of the pitch: of which a cell's light is made up
_erf = np.vectorize(math.erf, otypes=[np.float64])


@dataclass(frozen=True, slots=True, eq=False)
class Course:
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


def course(along: Floats, cells: int, sigma: float, gap: float, rim: float) -> Course:
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
    return Course(
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


@dataclass(frozen=True, slots=True, eq=False)
class Blinking:
    """What either class shows at P places."""

    shown: Floats  # (2, P)
    later: Floats  # (2, P) how that changes by a cycle
    shapes: Floats  # (2, 2, P) and by its shapes


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """The light of a panel's picture at P places; summed up in place."""

    light: Floats  # (P,)
    slopes: Floats  # (unknowns, P) how it changes with each of them
    by_place: Floats  # (2, P) and with the place, across and down

    @classmethod
    def of(
        cls, unknown: Floats, across: Course, down: Course, white: Mask, blinking: Blinking, u: Floats, v: Floats
    ) -> Model:
        """Of cells of which these (cells²,) are `white`, at the places (u, v) of the panel."""
        cells, places = len(across.light), len(u)
        model = cls(np.full(places, unknown[-1]), np.zeros((len(unknown), places)), np.zeros((2, places)))
        for cell, own in enumerate(white.reshape(-1).astype(int).tolist()):
            model._add_cell(unknown, across, down, cell, own, blinking)
        model.slopes[-1] = 1.0
        model._add_beside(unknown, across, down)
        model.light[:] += unknown[BESIDE:RIM] @ model.slopes[BESIDE:RIM]
        p, q = 2 * u - 1, 2 * v - 1
        along_u, along_v = model.by_place * (0.5 * cells)
        turned = p * along_u + q * along_v
        ways = [along_u, p * along_u, q * along_u, along_v, p * along_v, q * along_v, p * turned, q * turned]
        model.slopes[:WAYS] = ways
        return model

    @property
    def outside(self) -> Floats:
        """(P,) how much of a place lies beside the panel."""
        return np.asarray(self.slopes[BESIDE:RIM].sum(axis=0))

    def _add_cell(
        self, unknown: Floats, across: Course, down: Course, cell: int, own: int, blinking: Blinking
    ) -> None:
        """The light of one cell, of the class `own`, and of its spots."""
        both, slopes = _at_crossings, self.slopes
        row, column = divmod(cell, len(across.light))
        light = both(across.light[column], down.light[row])
        full = (light >= 1e-4) * unknown[GAIN + cell]
        lit = full * blinking.shown[own]
        of_spots = list(enumerate(unknown[SPOT:BESIDE]))
        spots = [both(across.spot[column, s], down.spot[row, s]) for s, _ in of_spots]
        shape = 1 + sum(b * spots[s] for s, b in of_spots)
        tilt = [
            sum(b * both(across.steep[column, s], down.spot[row, s]) for s, b in of_spots),
            sum(b * both(across.spot[column, s], down.steep[row, s]) for s, b in of_spots),
        ]
        self.light[:] += lit * light * shape
        self.by_place[0] += lit * (both(across.slope[column], down.light[row]) * shape + light * tilt[0])
        self.by_place[1] += lit * (both(across.light[column], down.slope[row]) * shape + light * tilt[1])
        for k, part in ((BLUR, "blurred"), (GAP, "gapped"), (RIM, "rimmed")):
            of_part = both(getattr(across, part)[column], down.light[row])
            slopes[k] += lit * shape * (of_part + both(across.light[column], getattr(down, part)[row]))
        slopes[PHASE + own] += full * light * shape * blinking.later[own]
        slopes[LONGER:PHASE] += full * light * shape * blinking.shapes[:, own]
        for s, b in of_spots:
            slopes[SPOT + s] += lit * light * spots[s]
            wider = both(across.wider[column, s], down.spot[row, s]) + both(across.spot[column, s], down.wider[row, s])
            slopes[BLUR] += lit * light * b * wider
        slopes[GAIN + cell] = (light >= 1e-4) * light * shape * blinking.shown[own]

    def _add_beside(self, unknown: Floats, across: Course, down: Course) -> None:
        """What lies beside the panel, left, right, above and below: of a corner only at the left, or at the right."""
        slopes, by_place = self.slopes, self.by_place
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


def _at_crossings(of_column: Floats, of_row: Floats) -> Floats:
    """(P,) what is of a column's places times what is of a row's, on the whole grid."""
    product: Floats = (of_row[:, None] * of_column).reshape(-1)
    return product
