"""Finds what may be a panel in a picture that is exposed so shortly that dark bands cut panels into pieces.

Where both classes' bands are deep, each column of a panel is bright and dark by turns, and hardly anything else is: a
place is a panel's if any window of rows around it, as high as the longest dark band, holds both. What stands out from
that is what is seen so from some of these rows only: the edges of other things.

Where one class's bands are shallow, what is lit is bright within a window around it; dark bands are bridged along the
columns. A window that reaches as far as the bridges do holds back what is only brighter than a panel's dark frame:
wherever a bridge could lead from a panel, the panel's own light sets the threshold.

Bands are as high on a near panel as on a far one, so one picture of half the size serves for all. Bands also cut
corners off, so a rough square is the smallest four-sided figure around what is lit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi import shutter
from ledpi.decode.band_light import min_contrast
from ledpi.decode.find import AT_BORDER, NOT_FOUR_SIDED, TOO_SMALL, Candidate
from ledpi.decode.sides import Points, Singles, areas, as_corners, as_points, cross
from ledpi.kernels import smallest as kernel
from ledpi.kernels.library import compiled
from ledpi.records import Floats, Frame, PanelSpec, Pixels, Rejected, Transfer
from ledpi.tone import linear_light

STRIPED_CONTRAST = 0.5  # bands deeper than this cut a panel into pieces
SCALE = 2  # pixels of the picture in one of the half-sized
# Of the way from the darkest to the brightest code: by the first, far panels keep their corners; by the second, half of
# the light once codes are sRGB, what is beside a near panel does not grow together with it.
THRESHOLDS = 0.5, 0.7
MIN_CONTRAST = 16  # codes: less is noise and texture
# Of bright to dark, that is blinking: that, or this share of what the shallowest bands have.
BLINKING, LEAST_OF_BANDS = 2.5, 0.75
BRIGHT_SHARE = 2.5  # what is darker than the brightest near by by this is none of a panel
OCTAVE = 20  # codes of twice the light
LEAST_LIGHT = 0.01  # of full scale: less is as good as dark
MIN_PX = 4  # of the half-sized picture: less is a speck
MIN_SOLIDITY = 0.6  # area over that of the convex hull; a corner may be dark
MAX_OUTLINE = 12  # corners of an outline, of which four sides are chosen
OUTLINE_PX = 1.0  # by which an outline with few corners may be off, at first
LEAST_TURN = 0.05  # sine of the angle between neighbouring sides


class StripedFinder:
    """Keeps the pictures it works on, for frames of one size."""

    def __init__(self, width: int, height: int, specs: Sequence[PanelSpec], smallest_px: float) -> None:
        """`specs`: the kinds of blinking that panels may have; `smallest_px`: side of the smallest that can be read."""
        self._specs = tuple(specs)
        self._smallest_px = smallest_px
        self._half = np.empty((max(1, height // SCALE), max(1, width // SCALE)), np.uint8)
        self._brightest, self._darkest, self._most, self._least, self._threshold, self._lit, self._half_octaves = (
            np.empty_like(self._half) for _ in range(7)
        )
        self._brighten = np.round(255 * np.sqrt(np.arange(256) / 255)).astype(np.uint8)

    def find(self, frame: Frame) -> tuple[list[Candidate], list[Rejected]]:
        """Candidates, of one thing maybe two; and what was dropped."""
        cv2.resize(frame.pixels, self._half.shape[::-1], dst=self._half, interpolation=cv2.INTER_AREA)
        if frame.transfer == "linear":
            cv2.LUT(self._half, self._brighten, dst=self._half)
        self._light = _brightened(frame.transfer)
        self._contrast = min_contrast(self._specs, frame.exposure_us)
        bridge = (math.ceil(self.stripe_rows(frame) / SCALE) + 2) | 1
        found: list[Candidate] = []
        dropped: list[Rejected] = []
        if self.is_cut(frame):
            outlines = self._blinking(frame, bridge)
        else:
            window = np.ones((2 * bridge + 1, 2 * bridge + 1), np.uint8)
            cv2.dilate(self._half, window, dst=self._brightest)
            cv2.erode(self._half, window, dst=self._darkest)
            cv2.add(self._darkest, MIN_CONTRAST, dst=self._least)
            outlines = [outline for share in THRESHOLDS for outline in self._bright(share, bridge)]
        for outline in outlines:
            result = self._candidate(outline)
            if isinstance(result, Candidate):
                found.append(result)
            elif result is not None:
                dropped.append(result)
        return found, dropped

    def stripe_rows(self, frame: Frame) -> float:
        """Height of the longest dark band that cuts panels into pieces; 0 where the exposure smooths the bands.

        Where a black cell stands on a white one, a dark band of either may meet one of the other.
        """
        return max(
            sum(
                (1.0 - spec.duty) / (hz * frame.row_time_us * 1e-6)
                for hz in (spec.black_hz, spec.white_hz)
                if shutter.contrast(hz, frame.exposure_us, spec.duty) > STRIPED_CONTRAST
            )
            for spec in self._specs
        )

    def is_cut(self, frame: Frame) -> bool:
        """Whether the bands of both classes are so deep that they cut panels."""
        return all(
            shutter.contrast(hz, frame.exposure_us, spec.duty) > STRIPED_CONTRAST
            for spec in self._specs
            for hz in (spec.black_hz, spec.white_hz)
        )

    def _blinking(self, frame: Frame, bridge: int) -> list[Pixels]:
        """Outlines of what is bright and dark within every `bridge` rows of each column."""
        ratio = min(BLINKING, LEAST_OF_BANDS * self._shallowest(frame))
        cv2.LUT(self._half, _octaves(frame.transfer), dst=self._half_octaves)
        column, lit = np.ones((bridge, 1), np.uint8), self._lit
        cv2.dilate(self._half_octaves, column, dst=self._most)
        cv2.erode(self._half_octaves, column, dst=self._least)
        cv2.subtract(self._most, self._least, dst=self._least)
        cv2.dilate(self._most, np.ones((bridge, 2 * bridge + 1), np.uint8), dst=self._brightest)
        cv2.subtract(self._brightest, self._most, dst=self._most)
        cv2.compare(self._least, OCTAVE * math.log2(ratio), cv2.CMP_GT, dst=lit)
        cv2.compare(self._most, OCTAVE * math.log2(BRIGHT_SHARE), cv2.CMP_LT, dst=self._most)
        cv2.bitwise_and(lit, self._most, dst=lit)
        across = np.ones((1, (bridge // 2) | 1), np.uint8)
        cv2.morphologyEx(lit, cv2.MORPH_CLOSE, across, dst=lit)  # walls between cells
        cv2.erode(lit, column, dst=lit)  # whence any of them is seen
        return self._outlines()

    def _shallowest(self, frame: Frame) -> float:
        """Light of the brightest row over that of the darkest, in the shallowest bands."""
        depth = min(
            0.5 * shutter.contrast(hz, frame.exposure_us, spec.duty)
            for spec in self._specs
            for hz in (spec.black_hz, spec.white_hz)
        )
        return (1 + depth) / max(1 - depth, 1e-3)

    def _bright(self, share: float, bridge: int) -> list[Pixels]:
        """Outlines of what is bright within a window, dark bands bridged."""
        cv2.addWeighted(self._brightest, share, self._darkest, 1.0 - share, 0.0, dst=self._threshold)
        cv2.max(self._threshold, self._least, dst=self._threshold)
        lit = self._lit
        cv2.compare(self._half, self._threshold, cv2.CMP_GT, dst=lit)
        across = (bridge // 2) | 1
        cv2.morphologyEx(lit, cv2.MORPH_CLOSE, np.ones((bridge, 1), np.uint8), dst=lit)  # dark bands
        cv2.morphologyEx(lit, cv2.MORPH_CLOSE, np.ones((1, across), np.uint8), dst=lit)  # walls between cells
        return self._outlines()

    def _outlines(self) -> list[Pixels]:
        lit = self._lit
        cv2.morphologyEx(lit, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8), dst=lit)  # what bridges led to
        outlines, levels = cv2.findContours(lit, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        if not outlines:
            return []
        # A panel in its dark frame may be enclosed by a bright wall, all around: only outlines of holes are none.
        return [outline for outline, level in zip(outlines, levels[0], strict=True) if level[3] < 0]

    def _has_contrast(self, x: int, y: int, width: int, height: int) -> bool:
        """Whether any two places in a box are as bright and as dark as a panel has them."""
        darkest, brightest, _, _ = cv2.minMaxLoc(self._half[y : y + height, x : x + width])
        return bool(self._light[int(brightest)] > self._contrast * self._light[int(darkest)])

    def _candidate(self, outline: Pixels) -> Candidate | Rejected | None:
        """A candidate, why it is none, or None for specks."""
        x, y, width, height = cv2.boundingRect(outline)
        if min(width, height) < MIN_PX or not self._has_contrast(x, y, width, height):
            return None
        if x <= 0 or y <= 0 or x + width >= self._half.shape[1] or y + height >= self._half.shape[0]:
            return AT_BORDER
        hull = cv2.convexHull(outline)
        area, of_hull = cv2.contourArea(outline), cv2.contourArea(hull)
        if not area > MIN_SOLIDITY * of_hull:
            return NOT_FOUR_SIDED
        corners = smallest_square_around(_few_corners(hull))
        if corners is None:
            return NOT_FOUR_SIDED
        side = math.sqrt(float(areas(as_points(corners))))
        if (side + 1.0) * SCALE < self._smallest_px:
            return TOO_SMALL
        # An outline runs through the centres of the outermost lit pixels: half a pixel inside the edge.
        middle = corners.mean(axis=0)
        corners = middle + (corners - middle) * (1.0 + 1.0 / max(side, 2.0))
        return Candidate(
            corners=(corners + 0.5) * SCALE - 0.5,
            side_px=(side + 1.0) * SCALE,
            misfit=abs(math.log(side * side / of_hull)),
            tolerance_px=1.5 * SCALE,
        )


def _few_corners(hull: Pixels) -> Floats:
    """(K, 2) the hull's corners, or fewer that are close to it."""
    tolerance = OUTLINE_PX
    few = cv2.approxPolyDP(hull, tolerance, True)
    while len(few) > MAX_OUTLINE:
        tolerance *= 1.5
        few = cv2.approxPolyDP(hull, tolerance, True)
    corners: Floats = few[:, 0].astype(np.float64)
    return corners


def smallest_square_around(outline: Floats) -> Floats | None:
    """(4, 2) corners of the smallest quadrilateral on four sides of a convex outline (K, 2), first nearest the origin.

    Clockwise in the picture, as the outline. A square with a corner cut off is that square again: no other side can be
    left out at the cost of so little.
    """
    if len(outline) < 4:
        return None
    start = np.ascontiguousarray(outline).view(np.complex128)[:, 0]
    if float((start[:-1].conj() * start[1:]).imag.sum() + (start[-1].conj() * start[0]).imag) < 0:
        start = start[::-1]
    best = kernel.smallest_square(start) if compiled() else _smallest(start)
    return None if best is None else as_corners(np.roll(best, -int((best.real + best.imag).argmin())))


def _smallest(start: Points) -> Points | None:
    """`kernel.smallest_square`, in numpy: of all ways of choosing four sides."""
    along = np.roll(start, -1) - start
    chosen = _fours(len(start))
    on, way = start[chosen], along[chosen]
    onward, next_way = np.roll(on, -1, axis=1), np.roll(way, -1, axis=1)
    turn = cross(way, next_way)
    convex = (turn > LEAST_TURN * np.abs(way) * np.abs(next_way)).all(axis=1)
    if not convex.any():
        return None
    corners = on[convex] + way[convex] * (cross(onward - on, next_way)[convex] / turn[convex])
    areas = 0.5 * cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    smallest: Points = corners[np.where(areas > 0, areas, np.inf).argmin()]
    return smallest


@cache
def _fours(count: int) -> NDArray[np.int64]:
    """(…, 4) all ways of choosing four of `count`, in order."""
    return np.array(list(combinations(range(count), 4)))


@cache
def _brightened(transfer: Transfer) -> Singles:
    """(256,) the light of codes; of those of a picture that was linear, once it is brightened."""
    if transfer == "linear":
        return np.square(np.arange(256, dtype=np.float32) / 255)
    return linear_light(transfer, mark_saturated=False)


@cache
def _octaves(transfer: Transfer) -> Pixels:
    """(256,) the logarithm of that light, OCTAVE to twice as much."""
    return np.round(OCTAVE * np.log2(np.maximum(_brightened(transfer), LEAST_LIGHT) / LEAST_LIGHT)).astype(np.uint8)
