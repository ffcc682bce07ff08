"""Whether a panel that its inner lines alone tell ends where they say: what is beside it does not blink as it does.

Lines tell a lattice a row aside as well, or one of half the rows, and its pattern may be another word. Such a lattice
has something among its cells that does not blink, or cells of the panel beside it that do. So each of its rows and
columns must blink for itself, and none of the four beside them as much.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ledpi.decode.cells import CellSamples, sample_cells, unit_square_to
from ledpi.decode.evidence import Doubles, Evidence
from ledpi.decode.single_frame import single_evidence
from ledpi.decode.words import weakest_row
from ledpi.geometry import distort, undistort
from ledpi.records import Frame, Intrinsics, Mask, PanelSpec, Quad, Rejected
from ledpi.tone import SATURATED

# Log odds by which each row and column has its word's bands rather than none. At 1 m the weakest of a panel has 90 to
# 250. Of a row with log odds of m, noise has the variance 2m: one that does not blink reaches this never.
LEAST_WITHIN = 45.0
# Of the weakest row within, what a row beside it may have. A row of the panel has all of it, and by noise less than a
# half in 1 of 100 at most: of a lattice aside, of which a row within must blink by noise alone already.
MOST_BESIDE = 0.5
# Times the deviation of the panel's cells from what they have in common, bands and all: what deviates more is no cell
# of it. (What is even, a sheet or window, seems to blink where it is taken for such a cell.)
MOST_UNLIKE = 2.0


def ends_where_told(
    frame: Frame, quad: Quad, samples: CellSamples, shown: Doubles, spec: PanelSpec, intrinsics: Intrinsics | None
) -> bool:
    """Whether `quad`, with these `samples`, is where a panel is whose cells have shown these bands (cells, P)."""
    evidence = single_evidence(samples, frame, spec)
    if isinstance(evidence, Rejected):
        return False
    weakest = weakest_row(evidence, shown)
    if not weakest > LEAST_WITHIN:
        return False
    # Here what is black or saturated tells that it does not blink.
    frame = replace(frame, pixels=np.clip(frame.pixels, 1, SATURATED - 1))
    return all(
        _blinks_beside(frame, quad, turns, shown, spec, intrinsics) < MOST_BESIDE * weakest for turns in range(4)
    )


def _blinks_beside(
    frame: Frame, quad: Quad, turns: int, shown: Doubles, spec: PanelSpec, intrinsics: Intrinsics | None
) -> float:
    """Log odds of the row beyond the side after so many: that its cells have bands of either class to none.

    ∞ where that cannot be seen, as beyond the picture's border.
    """
    cells = round(len(shown) ** 0.5)
    turned = np.rot90(shown.reshape(cells, cells, -1), turns)
    of_row = np.concatenate([np.zeros_like(turned[:1]), turned[:-1]]).reshape(shown.shape)
    samples = sample_cells(frame, _a_row_up(quad, turns, cells, intrinsics), cells, intrinsics)
    if isinstance(samples, Rejected):
        return np.inf
    alike = _are_alike(samples)
    if not alike.any():
        return -np.inf
    evidence = single_evidence(samples, frame, spec)
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
    at = np.array([[0.0, up, 1.0], [1.0, up, 1.0], [1.0, 1.0 + up, 1.0], [0.0, 1.0 + up, 1.0]])
    moved = at @ unit_square_to(corners).T
    moved = moved[:, :2] / moved[:, 2:]
    return replace(quad, corners_px=moved if intrinsics is None else distort(moved, intrinsics))


def _best_of_classes(evidence: Evidence, shown: Doubles, of_class: Doubles) -> Doubles:
    """(cells,) log odds of each cell's likelier bands of those `of_class` (classes, P) to those `shown` (cells, P)."""
    left = evidence.score - np.tensordot(evidence.information, shown, axes=((2, 3), (0, 1)))
    own = np.einsum("cicj->cij", evidence.information)
    odds = [left @ bands - 0.5 * (own @ bands @ bands) for bands in of_class]
    return np.asarray(np.max(odds, axis=0), np.float64)
