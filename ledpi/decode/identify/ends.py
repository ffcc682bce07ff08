"""Whether a panel that its inner lines alone tell ends where they say: what is beside it does not blink as it does.

Lines tell a lattice a row aside as well, or one of half the rows, and its pattern may be another word. Such a lattice
has something among its cells that does not blink, or cells of the panel beside it that do. So each of its rows and
columns must blink for itself, and none of the four beside them as much, as far as these are in the picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ledpi.decode.cells import OUTSIDE, CellSamples, Lattice, sample_cells
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.evidence.waves import turned
from ledpi.decode.identify.words import weakest_row
from ledpi.geometry import box, distort, in_square, undistort
from ledpi.records import Floats, Frame, Intrinsics, Mask, PanelSpec, Quad, Rejected
from ledpi.tone import SATURATED

SIDES = 4
# Log odds by which each row and column has its word's bands rather than none. The weakest of a panel has 90 to 250 in
# one frame at 1 m. Of a row with log odds of m, noise has the variance 2m: one that does not blink reaches this never.
LEAST_WITHIN = 45.0
# Of the weakest row within, what a row beside it may have. A row of the panel has all of it, and by noise less than a
# half in 1 of 100 at most: of a lattice aside, of which a row within must blink by noise alone already.
MOST_BESIDE = 0.5
# Times the deviation of the panel's cells from what they have in common, bands and all: what deviates more is no cell
# of it. (What is even, a sheet or window, seems to blink where it is taken for such a cell.)
MOST_UNLIKE = 2.0


@dataclass(frozen=True, slots=True)
class Ends:
    """What a lattice and the four rows beside it show, in the frames of a stream, or in one.

    All in the same frames, so that they can be compared.
    """

    within: PanelMemory
    aside: tuple[PanelMemory, ...]
    in_sight: Mask  # (SIDES, n) cells of the rows beside: in the picture, in all frames

    @classmethod
    def of(cls, spec: PanelSpec) -> Ends:
        """Before there was a frame."""
        return cls(PanelMemory(spec), (PanelMemory(spec),) * SIDES, np.ones((SIDES, 1), np.bool_))

    def after(self, frame: Frame, quad: Quad, samples: CellSamples, intrinsics: Intrinsics | None) -> Ends:
        """With a further frame, in which `quad` has `samples`. Where a row beside is out of sight, it begins anew."""
        # What is black or saturated tells here that it does not blink.
        visible = replace(frame, pixels=np.clip(frame.pixels, 1, SATURATED - 1))
        cells, times = samples.lattice.cells, frame.without_picture()
        rows_up = [_a_row_up(quad, turns, cells, intrinsics) for turns in range(SIDES)]
        in_sight = self.in_sight & np.array([_in_sight(frame, up, cells) for up in rows_up])
        if not in_sight.any(axis=1).all():
            return Ends.of(self.within.spec)
        beside = [_sampled(visible, up, samples.lattice, intrinsics) for up in rows_up]
        aside = []
        for memory, light in zip(self.aside, beside, strict=True):
            if isinstance(light, Rejected):
                return Ends.of(self.within.spec)
            aside.append(memory.after(light, times)[0])
        return Ends(self.within.after(samples, times)[0], tuple(aside), in_sight)

    def are_where_told(self, shown: Floats, origin_ns: int) -> bool:
        """Whether the panel ends there whose cells have shown these bands (cells, P), counted from row 0 then."""
        if self.within.frames == 0:
            return False
        evidence = self.within.evidence()
        if isinstance(evidence, Rejected):
            return False
        shown = turned(shown, self.within.spec.waves_hz, 1e-9 * (origin_ns - self.within.origin_ns))
        # What is in sight of a row beside would have as much of them, were it the panel's.
        least = weakest_row(evidence, shown) * self.in_sight.mean(axis=1)
        return bool(least.min() > LEAST_WITHIN) and all(
            _blinks(memory, turns, shown, self.in_sight[turns]) < MOST_BESIDE * least[turns]
            for turns, memory in enumerate(self.aside)
        )


def _blinks(aside: PanelMemory, turns: int, shown: Floats, in_sight: Mask) -> float:
    """Log odds of the row beyond the side after so many: that its cells have bands of either class to none."""
    cells = round(len(shown) ** 0.5)
    turned_round = np.rot90(shown.reshape(cells, cells, -1), turns)
    of_row = np.concatenate([np.zeros_like(turned_round[:1]), turned_round[:-1]]).reshape(shown.shape)
    alike = _are_alike(aside.newest[0]) & in_sight
    if not alike.any():
        return -np.inf
    evidence = aside.evidence()
    if isinstance(evidence, Rejected):
        return np.inf
    return float(_best_of_classes(evidence, of_row, np.unique(shown, axis=0))[:cells][alike].sum())


def _are_alike(samples: CellSamples) -> Mask:
    """(n,) which cells of the first row may be of one panel with all others."""
    cells = samples.lattice.cells
    own = samples.light / samples.light.mean(axis=1)[:, None]
    deviation = np.std(own - np.median(own[cells:], axis=0), axis=1)
    return np.asarray(deviation[:cells] < MOST_UNLIKE * deviation[cells:].max())


def _a_row_up(quad: Quad, turns: int, cells: int, intrinsics: Intrinsics | None) -> Quad:
    """The lattice one row up, once the panel is turned by so many quarters against the clock."""
    corners = np.roll(quad.corners_px if intrinsics is None else undistort(quad.corners_px, intrinsics), -turns, axis=0)
    up = -1.0 / cells
    moved = in_square(corners, box(0.0, up, 1.0, 1.0 + up))
    return replace(quad, corners_px=moved if intrinsics is None else distort(moved, intrinsics))


def _sampled(frame: Frame, at: Quad, like: Lattice, intrinsics: Intrinsics | None) -> CellSamples | Rejected:
    """The light of a lattice; where that is out of sight, as at the picture's border."""
    samples = sample_cells(frame, at, like.cells, intrinsics, like=like)
    if samples != OUTSIDE:
        return samples
    height, width = frame.pixels.shape
    beyond_px = max(-at.corners_px.min(), (at.corners_px - (width - 1, height - 1)).max()) + at.bend_px
    if not beyond_px < height:
        return OUTSIDE
    by = math.ceil(beyond_px)
    lens = None if intrinsics is None else replace(intrinsics, cx=intrinsics.cx + by, cy=intrinsics.cy + by)
    wider, there = replace(frame, pixels=np.pad(frame.pixels, by, "edge")), replace(at, corners_px=at.corners_px + by)
    samples = sample_cells(wider, there, like.cells, lens, like=like)
    return samples if isinstance(samples, Rejected) else replace(samples, rows=samples.rows - np.float32(by))


def _in_sight(frame: Frame, at: Quad, cells: int) -> Mask:
    """(n,) which cells of a lattice's first row are wholly in the picture."""
    posts = [(k / cells, row / cells) for row in (0, 1) for k in range(cells + 1)]
    seen, last = in_square(at.corners_px, np.array(posts)), np.array(frame.pixels.shape[::-1]) - 1
    inside: Mask = np.all((seen >= at.bend_px) & (seen <= last - at.bend_px), axis=1).reshape(2, -1).all(axis=0)
    return inside[:-1] & inside[1:]


def _best_of_classes(evidence: Evidence, shown: Floats, of_class: Floats) -> Floats:
    """(cells,) log odds of each cell's likelier bands of those `of_class` (classes, P) to those `shown` (cells, P)."""
    left, own = evidence.unexplained(shown), evidence.of_own_bands
    odds = [left @ bands - 0.5 * (own @ bands @ bands) for bands in of_class]
    return np.asarray(np.max(odds, axis=0), np.float64)
