"""How far within the sides of a square its panel ends, told by what blinks.

The light of a panel whose cells are flat, without walls, shows no lattice. A bezel as bright, or a bright thing that
touches it, then looks like a part of it. But neither blinks. So a strip along each side is asked how much it does,
beside the strips further in, by how the frames differ: where a part of it is no panel, so much of its bands is missing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ledpi.decode.cells import INSET, MIN_CELL_PX, sample_cells
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.evidence.waves import turned
from ledpi.geometry import box, distort, in_square, undistort
from ledpi.records import Floats, Frame, Intrinsics, PanelSpec, Quad, Rejected

SIDES = 4
FIRST, ONE_OF = 4, 8  # frames that are looked at, and then one of so many
STRIPS = (4, 2)  # in a cell: as many as are not too thin; where fewer are, nothing is told
NOTHING = 1e-9  # of all information: what adds less tells nothing
# Deviations by which a strip lacks bands where a panel ends further in. Of 2,000 strips of whole panels, flat or
# nearly, in bright rooms, sharpened, driven past, none had more than 3.5.
SURELY = 5.0
# A share of the side: the deviation of what nothing tells. Perhaps one flat panel in ten stands in something as bright,
# with which its word is still read where that is no wider than 0.09: √(0.1·0.09²/3).
UNTOLD = 0.016
WIDEST = 0.12  # of the side: with a wider frame the word is not read, so what seems so wide is something else


@dataclass(frozen=True, slots=True, kw_only=True)
class Inward:
    """By which shares of a square's side its panel ends further in. Where nothing is told, by none, perhaps."""

    shares: tuple[float, ...] = (0.0,) * SIDES  # at the sides between corners 0 and 1, 1 and 2, …
    sigma: float = UNTOLD  # of these

    def of(self, quad: Quad, intrinsics: Intrinsics | None) -> Quad:
        """The panel within the square."""
        if not any(self.shares):
            return quad
        top, right, bottom, left = self.shares
        within = box(left, top, 1 - right, 1 - bottom)
        return replace(quad, corners_px=_placed(_straight(quad, intrinsics), within, intrinsics))


@dataclass(frozen=True, slots=True)
class Rim:
    """What the strips along a square's sides show, in the frames of a stream."""

    cells: int
    sides: tuple[PanelMemory, ...]  # of the strips between corners 0 and 1, 1 and 2, …
    strips: int = STRIPS[0]  # in a cell
    frames: int = 0  # in which the panel was read
    inward: Inward = Inward()  # how far in it ends, as told by them

    @classmethod
    def of(cls, spec: PanelSpec, cells: int) -> Rim:
        """Before there was a frame."""
        return cls(cells, (PanelMemory(spec),) * SIDES)

    def after(self, frame: Frame, quad: Quad, shown: Floats, origin_ns: int, intrinsics: Intrinsics | None) -> Rim:
        """With a further frame, which shows the panel in `quad`.

        `shown`: the bands (cells, P) of its cells, counted from row 0 then. Where strips get too thin, it begins anew.
        """
        further = replace(self, frames=self.frames + 1)
        if further.frames > FIRST and further.frames % ONE_OF != 0:
            return further
        looked = further._with_strips(frame, quad, intrinsics)
        return replace(looked, inward=looked._tell(shown, origin_ns))

    def _with_strips(self, frame: Frame, quad: Quad, intrinsics: Intrinsics | None) -> Rim:
        shortest_px = np.hypot(*(np.roll(quad.corners_px, -1, axis=0) - quad.corners_px).T).min()
        not_thin = [strips for strips in STRIPS if shortest_px > MIN_CELL_PX * self.cells * strips]
        if not not_thin:
            return self
        strips, before = self.strips, self.sides
        if strips not in not_thin:
            strips, before = not_thin[0], (PanelMemory(before[0].spec),) * SIDES
        depth = 1.0 / strips  # of as many strips as a panel has rows: they are looked at as if they were a panel
        straight = _straight(quad, intrinsics)
        sides = []
        for turns, memory in enumerate(before):
            corners = _placed(np.roll(straight, -turns, axis=0), box(0.0, 0.0, 1.0, depth), intrinsics)
            along = Quad(corners_px=corners, corner_sigma_px=quad.corner_sigma_px, bend_px=quad.bend_px)
            light = sample_cells(frame, along, self.cells, intrinsics, like=memory.lattice)
            sides.append(memory if isinstance(light, Rejected) else memory.after(light, frame.without_picture())[0])
        return replace(self, strips=strips, sides=tuple(sides))

    def _tell(self, shown: Floats, origin_ns: int) -> Inward:
        told = np.array([self._lacks(memory, turns, shown, origin_ns) for turns, memory in enumerate(self.sides)])
        lacks, sigma = told[..., 0], told[..., 1]  # (sides, outer strips)
        strips = np.logical_and.accumulate(lacks > SURELY * sigma, axis=1).sum(axis=1)  # that lack bands, of each side
        depth, of_mean = 1.0 / (self.strips * self.cells), _sigma_of_mean(sigma[:, 0])
        if (lacks[:, 0] > 0).all() and lacks[:, 0].mean() > SURELY * of_mean:  # all together, if none alone
            strips = np.maximum(strips, 1)
        lacking = strips > 0
        if not lacking.any():
            return Inward(sigma=min(depth * of_mean, UNTOLD))
        # The outermost share of a strip, where light is blurred, is not looked at, and neither is the innermost.
        until = np.arange(lacks.shape[1]) <= strips[:, None]
        ends = INSET * (2 * strips - 1) + (1 - 2 * INSET) * np.where(until, lacks, 0.0).sum(axis=1)
        each = float(np.sqrt(np.mean(np.square(sigma[lacking, 0]))))
        if lacking.all() and np.ptp(ends) < SURELY * each:  # a frame is as wide on all sides
            ends, each = np.full(SIDES, ends.mean()), each / math.sqrt(SIDES)
        shares = np.where(lacking, depth * ends, 0.0)
        if shares.max() > WIDEST:
            return Inward()
        return Inward(shares=tuple(shares.tolist()), sigma=min(depth * math.hypot(INSET, each), UNTOLD))

    def _lacks(self, memory: PanelMemory, turns: int, shown: Floats, origin_ns: int) -> list[tuple[float, float]]:
        """How much of its bands each outer strip lacks, of what inner ones have of theirs; and the deviation."""
        outer = self.cells // 2
        evidence = memory.of_comparisons()
        if evidence is None:
            return [(0.0, np.inf)] * outer
        shown = turned(shown, memory.spec.waves_hz, 1e-9 * (origin_ns - memory.origin_ns))
        rows = np.rot90(shown.reshape(self.cells, self.cells, -1), turns)
        has, variance = _bands_of_rows(evidence, rows[np.arange(self.cells) // self.strips])
        inner = float(np.average(has[outer:], weights=1.0 / variance[outer:]))
        of_inner = float(np.sum(1.0 / variance[outer:])) ** -0.5
        if not inner > SURELY * of_inner:
            return [(0.0, np.inf)] * outer
        lit = memory.newest[0].light.reshape(self.cells, -1).mean(axis=1)
        # Light that falls on a panel dilutes its bands.
        left = np.maximum(lit[:outer] / lit[self.strips - 1], 1.0) * has[:outer] / inner
        sigma = np.sqrt(variance[:outer] + np.square(left * of_inner)) / inner
        return list(zip((1.0 - left).tolist(), sigma.tolist(), strict=True))


def _straight(quad: Quad, intrinsics: Intrinsics | None) -> Floats:
    """(4, 2) its corners before the lens."""
    return quad.corners_px if intrinsics is None else undistort(quad.corners_px, intrinsics)


def _placed(straight: Floats, places: Floats, intrinsics: Intrinsics | None) -> Floats:
    """(N, 2) pixels of places in the square of these corners (4, 2) before the lens."""
    placed = in_square(straight, places)
    return placed if intrinsics is None else distort(placed, intrinsics)


def _bands_of_rows(evidence: Evidence, shown: Floats) -> tuple[Floats, Floats]:
    """(rows,) how much each has of the bands `shown` (rows, columns, P), and the variance; by least squares."""
    n = len(shown)
    each = np.zeros((n, n, *shown.shape[1:]))
    each[np.arange(n), np.arange(n)] = shown
    each = each.reshape(n, n * n, -1)
    explained = np.tensordot(each, evidence.information, axes=((1, 2), (0, 1)))
    information = np.tensordot(explained, each, axes=((1, 2), (1, 2)))
    least = max(NOTHING * float(np.trace(information)), NOTHING)
    covariance = np.linalg.inv(information + least * np.eye(n))
    has = covariance @ np.tensordot(each, evidence.score, axes=((1, 2), (0, 1)))
    return np.asarray(has), np.diag(covariance)


def _sigma_of_mean(sigma: Floats) -> float:
    """The deviation of a mean by weights, of values with these deviations; infinite where all are."""
    weight = float(np.sum(1.0 / np.square(sigma)))
    return weight**-0.5 if weight > 0 else np.inf
