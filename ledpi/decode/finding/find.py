"""Squares in the pictures of a pyramid (find.c), panels by the lattices of their cells (lattice_squares.c), and a
glance at all of them (glance.c).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.core.library import NONE, ffi, lib, pointer
from ledpi.core.records import Floats, Frame, Mask, Pixels

MOST_SQUARES: int = lib.LEDPI_MOST_SQUARES  # in a frame: more is texture
MOST_LATTICE_SQUARES = 1024
LEVELS = 3  # halvings; the cells of a panel that fills the picture's height melt together at an eighth
# Finding compares neighbours only; a square root gives dark linear pictures the contrast they need.
_BRIGHTEN = np.round(255 * np.sqrt(np.arange(256) / 255)).astype(np.uint8)

# A picture, the shortest way around things in it, grey levels that what is lit is brighter than, and shares of the
# contrast by which it is, in 256ths.
Level: TypeAlias = tuple[Pixels, int, tuple[int, ...], tuple[int, ...]]


class SquareSearcher:
    """Searches the same pictures again and again, in room that it keeps."""

    def __init__(self, levels: Sequence[Level], smallest_px: float, cells: int, limits: Mapping[str, float]) -> None:
        """`levels`: pictures are read anew each time, the largest first. `limits`: as in decode/finding/outlines.py."""
        self._kept = tuple(levels)
        self._room = np.empty(lib.ledpi_find_room(*levels[0][0].shape), np.uint8)
        self._squares = np.empty((MOST_SQUARES, lib.LEDPI_SQUARE))
        self._distinct = np.empty(MOST_SQUARES, np.int64)
        self._result = ffi.new("FindResult *", (pointer(self._squares), pointer(self._distinct), MOST_SQUARES))
        self._wanted = ffi.new("FindWanted *", (smallest_px, cells, limits))
        self._levels = ffi.new("FindLevel[]", len(levels))
        for number, (picture, shortest, brighter_than, lit_by) in enumerate(levels):
            sizes = (*picture.shape, 2 << number, len(brighter_than), len(lit_by))
            self._levels[number] = (pointer(picture), *sizes, brighter_than, lit_by, shortest)

    def search(self) -> tuple[Floats, tuple[int, int, int]]:
        """Distinct squares (K, LEDPI_SQUARE), the best first; and how many outlines touch the picture's border, show
        no square, or show one that is too small.
        """
        found = self._result
        lib.ledpi_find(self._levels, len(self._kept), self._wanted, pointer(self._room), found)
        squares = self._squares[self._distinct[: found.distinct_count]]
        return squares, (found.at_border, found.not_four_sided, found.too_small)


class LatticeSearcher:
    """Finds lattices of cells in the pictures of a pyramid, in room that it keeps."""

    def __init__(self, height: int, width: int, cells: int) -> None:
        """`height`, `width`: of the largest picture. `cells`: along a panel's side."""
        self._cells, self._room = cells, np.empty(lib.ledpi_lattice_room(height, width), np.uint8)
        self._corners = np.empty((MOST_LATTICE_SQUARES, 4, 2))

    def search(self, pyramid: Sequence[Pixels]) -> Floats:
        """Corners (K, 4, 2) of what may be panels, in the picture that the `pyramid` begins with; until the next.

        Each further picture is half of the one before.
        """
        pictures = [(pointer(picture), *picture.shape) for picture in pyramid]
        count = lib.ledpi_lattice_squares(
            *(ffi.new("PyramidPicture[]", pictures), len(pictures), self._cells),
            *(pointer(self._room), len(self._corners), pointer(self._corners)),
        )
        return self._corners[:count]


class Hypothesis(NamedTuple):
    """A thing that may be there: mean light (samples,), what varies in it (K, samples), that volume's size in nats.

    Light y of covariance v·I + A·Aᵀ has squares over it of |y|² less those of y along the directions, each as long as
    the root of the share of its variance that is not v (Woodbury).
    """

    mean: Floats
    directions: Floats
    log_volume: float


class Template(NamedTuple):
    """A panel's picture. Gains and ways are dot products with its light less the mean, by least squares."""

    along: Floats  # (lines,) of the grid of samples, across and down, 0..1 from a panel's first corner
    inside: Mask  # (samples,) whether it is in the panel
    gains: Floats  # (cells², samples) each cell's gain, less the mean
    ways: Floats  # (8, samples) in which a homography is wrong
    panel: Hypothesis
    texture: Hypothesis
    independent: float  # samples, of those whose noise is the same as their neighbours'


class Glancer:
    """Glances at candidates by one template, in room that it keeps."""

    def __init__(self, cells: int, smallest_px: float, template: Template) -> None:
        """`smallest_px`: of a candidate's side, which is not looked at where it is less."""
        self._smallest_px = smallest_px
        lines, samples = len(template.along), len(template.along) ** 2
        self._padded = -(-samples // 16) * 16
        self._work = np.empty((3, self._padded), np.float32)
        self._glimpses = np.empty((2 * (MOST_SQUARES + MOST_LATTICE_SQUARES), lib.LEDPI_GLIMPSE))
        self._all: Any = ffi.cast("Glimpse *", pointer(self._glimpses))
        self._kept: list[NDArray[Any]] = []
        self._template = ffi.new("GlanceTemplate *")
        self._template[0] = {
            "cells": cells,
            "lines": lines,
            "size": self._padded,
            "along": self._keep(np.append(template.along, np.zeros(8))),
            "gains": self._keep(self._pad(template.gains)),
            "ways": self._keep(self._pad(template.ways)),
            "inside": self._keep(self._pad(template.inside), np.uint8),
            "panel": self._hypothesis(template.panel),
            "texture": self._hypothesis(template.texture),
            "independent": template.independent,
            "log_volume": template.panel.log_volume - template.texture.log_volume,
        }

    def look(
        self,
        pyramid: Sequence[Pixels],
        found: Sequence[Floats],
        bridged: Pixels | None,
        most_dimmed: float,
        *,
        at_once: int = MOST_SQUARES,
        turn: int = 1,
    ) -> tuple[Floats, Floats, Floats]:
        """Looks at those `found`, corners (N, 4, 2) each, for the different ones in the `pyramid`; the largest first.

        Their corners where a panel fits best (K, 4, 2), sides in pixels (K,), and how much likelier a panel is there
        than texture, in nats (K,); until the next. Where they are more than `at_once` the others have the next `turn`.
        Of a picture whose bands are `bridged` in the pyramid corners are as they were: what is not dimmed there in
        part, to this share, is none.
        """
        count = self._put(found)
        shown = (NONE, 0, 0) if bridged is None else (pointer(bridged), *bridged.shape)
        kept = lib.ledpi_glance(
            *self._given(pyramid, shown, most_dimmed, self._smallest_px, at_once, turn), count, self._all
        )
        seen = self._glimpses[:kept]
        return (seen[:, 8:16] if bridged is None else seen[:, :8]).reshape(-1, 4, 2), seen[:, 16], seen[:, 17]

    def look_at(self, pyramid: Sequence[Pixels], corners: Floats) -> tuple[Floats, Floats]:
        """Returns where panels fit best (N, 4, 2) from each of these corners (N, 4, 2), valid until the next call.

        Beside it how much likelier one is there than texture (N,), in nats.
        """
        count = self._put([corners])
        lib.ledpi_glance_at(*self._given(pyramid, (NONE, 0, 0), 1.0), count, self._all)
        return self._glimpses[:count, 8:16].reshape(-1, 4, 2), self._glimpses[:count, 17]

    def _put(self, found: Sequence[Floats]) -> int:
        count = 0
        for corners in found:
            self._glimpses[count : count + len(corners), :8] = corners.reshape(-1, 8)
            count += len(corners)
        return count

    def _given(self, pyramid: Sequence[Pixels], shown: Any, most_dimmed: float, *more: Any) -> tuple[Any, ...]:
        self._pyramid = ffi.new("PyramidPicture[]", [(pointer(picture), *picture.shape) for picture in pyramid])
        pictures = ffi.new("GlancePictures *", (self._pyramid, len(pyramid), shown, most_dimmed))
        return self._template, pictures, *more, pointer(self._work)

    def _hypothesis(self, of: Hypothesis) -> dict[str, Any]:
        mean, directions = self._keep(self._pad(of.mean)), self._keep(self._pad(of.directions))
        return {"mean": mean, "directions": directions, "ranks": len(of.directions)}

    def _pad(self, of_samples: NDArray[Any]) -> NDArray[Any]:
        none = [(0, 0)] * (of_samples.ndim - 1)
        return np.pad(of_samples, [*none, (0, self._padded - of_samples.shape[-1])])

    def _keep(self, array: NDArray[Any], dtype: Any = np.float32) -> Any:
        self._kept.append(np.ascontiguousarray(array, dtype))
        return pointer(self._kept[-1])


class Pyramid:
    """Pictures of frames of one size, each smaller than the last."""

    def __init__(self, height: int, width: int) -> None:
        self.smaller: list[Pixels] = [
            np.empty((max(1, height >> halvings), max(1, width >> halvings)), np.uint8)
            for halvings in range(1, LEVELS + 1)
        ]

    def of(self, frame: Frame) -> list[Pixels]:
        """The frame's picture, and smaller ones; until the next."""
        above: Pixels = frame.pixels
        for picture in self.smaller:
            cv2.resize(above, picture.shape[::-1], dst=picture, interpolation=cv2.INTER_AREA)
            if above is frame.pixels and frame.transfer == "linear":
                cv2.LUT(picture, _BRIGHTEN, dst=picture)
            above = picture
        return [frame.pixels, *self.smaller]
