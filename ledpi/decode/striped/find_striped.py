"""Finds what may be a panel in a picture that is exposed so shortly that dark bands cut panels into pieces.

Each column of a panel is bright and dark by turns, and hardly anything else is: a place is a panel's if every window
of rows around it, as high as the longest dark band, holds both. Edges of other things are seen from some of these
windows only. What holds both is as bright as what is brightest near by, too.

Bands are as high on a near panel as on a far one, so one picture of half the size serves for all. Bands also cut
corners off, so a rough square is a figure around what is lit (`around`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cache, lru_cache, partial

import cv2
import numpy as np

from ledpi import shutter
from ledpi.decode.corners.sides import areas, as_points
from ledpi.decode.finding.find import AT_BORDER, NOT_FOUR_SIDED, TOO_SMALL, Candidate
from ledpi.decode.striped.around import few_corners, rectangles_around, smallest_square_around
from ledpi.decode.striped.lattice import lattice_places, rough_lattice
from ledpi.decode.striped.light_window import min_contrast
from ledpi.records import Floats, Frame, PanelSpec, Pixels, Rejected, Singles, Transfer
from ledpi.tone import linear_light

STRIPED_CONTRAST = 0.8  # bands deeper than this cut a panel into pieces: of others the darkest rows, too, show its rim
# Deeper than this they still bend what is seen of a rim: from 640 µs to 1.2 ms edges refused one panel in ten.
BENDING_CONTRAST = 1.0 / 3.0
SCALE = 2  # pixels of the picture in one of the half-sized
# Of bright to dark, that is blinking: that, or this share of what the shallowest bands have; or what the walls between
# cells bring with them where a class's bands are gone.
BLINKING, LEAST_OF_BANDS, WALLS = 2.5, 0.95, 1.3
BRIGHT_SHARE = 2.5  # what is darker than the brightest near by by this is none of a panel
OCTAVE = 20  # codes of twice the light
LEAST_LIGHT = 0.01  # of full scale: less is as good as dark
# Pixels of the half-sized picture, and share of a thing: what hangs on to it by less is another.
LEAST_NECK, NECK = 3, 9
MIN_STRIPED_CELL_PX = 3.0  # as roughly found: of smaller cells no lattice is seen through lens and pixel
MUCH_LARGER = 2.0  # than a dark band
# Pixels of the half-sized picture, between the lit middles of cells: three fifths of a bare LED's pitch, which is 13
# of them at 1 m and 33 at 0.4 m.
GAPS = (8, 16, 32)
MIN_PX = 4  # of the half-sized picture: less is a speck
MIN_SOLIDITY = 0.6  # area over that of the convex hull; a corner may be dark


class StripedFinder:
    """Keeps the pictures it works on, for frames of one size."""

    def __init__(self, width: int, height: int, specs: Sequence[PanelSpec], smallest_px: float) -> None:
        """`specs`: the kinds of blinking that panels may have; `smallest_px`: side of the smallest that can be read."""
        self._specs = tuple(specs)
        self._dark_rows = lru_cache(maxsize=8)(partial(_dark_rows, self._specs))  # asked for at each step
        self._smallest_px = smallest_px
        # Two pixels at least: what has one OpenCV takes for a number.
        self._half = np.empty((max(1, height // SCALE), max(2, width // SCALE)), np.uint8)
        empty = (np.empty_like(self._half) for _ in range(5))
        self._octaves, self._brightest, self._most, self._least, self._lit = empty
        self._bridged = np.empty((height, width), np.uint8)
        self._hulls: list[Pixels] = []
        self._brighten = np.round(255 * np.sqrt(np.arange(256) / 255)).astype(np.uint8)

    def find(self, frame: Frame) -> tuple[list[Candidate], list[Rejected]]:
        """Candidates, of one thing maybe two; and what was dropped."""
        cv2.resize(frame.pixels, self._half.shape[::-1], dst=self._half, interpolation=cv2.INTER_AREA)
        if frame.transfer == "linear":
            cv2.LUT(self._half, self._brighten, dst=self._half)
        self._light = _brightened(frame.transfer)
        self._contrast = min_contrast(self._specs, frame.exposure_us, anywhere=True)
        bridge = (math.ceil(self.stripe_rows(frame) / SCALE) + 2) | 1
        found: list[Candidate] = []
        dropped: list[Rejected] = []
        self._hulls = []
        for outline in self._blinking(frame, bridge):
            result = self._candidate(outline)
            if isinstance(result, Candidate):
                found.append(result)
            elif result is not None:
                dropped.append(result)
        return found, dropped

    def find_again(self, frame: Frame) -> list[Candidate]:
        """Of the same frame: rectangles around the same things, along the sides that they show, and what joins several.

        Where bands cut two of its corners off, the smallest figure around a square leans on the cuts. Of what is not
        much larger than a dark band more than corners are missing, and in many a picture much is like that.
        """
        least_px = max(self._smallest_px, MUCH_LARGER * self.stripe_rows(frame))
        around = [(corners, 1.0) for hull in self._hulls for corners in rectangles_around(few_corners(hull))]
        for hull, by in self._joined():
            square = smallest_square_around(few_corners(hull))
            around += [] if square is None else [(square, by)]
            around += [(cv2.boxPoints(cv2.minAreaRect(hull)).astype(np.float64), by)]
        found = [self._grown(corners, by) for corners, by in around]
        return [candidate for candidate in found if candidate.side_px >= least_px]

    def _joined(self) -> list[tuple[Pixels, float]]:
        """Hulls of several things with little between them, as cells are that shine in their middles only.

        And how much larger than such a hull a panel is, whose cells end amid what is between them.
        """
        hulls, joined = self._hulls, []
        for gap in GAPS:
            cv2.morphologyEx(self._lit, cv2.MORPH_CLOSE, np.ones((gap, gap), np.uint8), dst=self._lit)
            outlines, _ = cv2.findContours(self._lit, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
            parts = [hull.mean(axis=(0, 1)).tolist() for hull in hulls]
            hulls = [cv2.convexHull(outline) for outline in outlines]
            joined += [
                (hull, 0.5 * gap)
                for hull in hulls
                if sum(cv2.pointPolygonTest(hull, part, measureDist=False) > 0 for part in parts) > 1
            ]
        return joined

    def stripe_rows(self, frame: Frame) -> float:
        """Height of the longest dark band that cuts panels into pieces; 0 where the exposure smooths the bands.

        Where a black cell stands on a white one, a dark band of either may meet one of the other.
        """
        return self._dark_rows(frame.exposure_us, frame.row_time_us, STRIPED_CONTRAST)

    def bent_rows(self, frame: Frame) -> float:
        """The same of those that do not cut panels, but are so deep that edges are not where light changes."""
        if self.stripe_rows(frame):
            return 0.0
        return self._dark_rows(frame.exposure_us, frame.row_time_us, BENDING_CONTRAST)

    def is_cut(self, frame: Frame) -> bool:
        """Whether the bands of both classes are so deep that they cut panels."""
        return all(
            shutter.contrast(hz, frame.exposure_us, spec.duty) > STRIPED_CONTRAST
            for spec in self._specs
            for hz in (spec.black_hz, spec.white_hz)
        )

    def bridged(self, frame: Frame) -> Frame:
        """The frame, its dark bands as bright as the rows around them: a panel with steady cells is whole there."""
        rows = math.ceil(self.stripe_rows(frame)) | 1
        cv2.morphologyEx(frame.pixels, cv2.MORPH_CLOSE, np.ones((rows, 1), np.uint8), dst=self._bridged)
        return replace(frame, pixels=self._bridged.view())

    def blinks(self, frame: Frame, candidates: Sequence[Candidate], cells: int) -> list[bool]:
        """Which of these, in the frame searched last, are as bright and dark as deep bands in as much as a cell.

        Squares that stand out of the wall by less than that are none of these.
        """
        if not candidates:
            return []
        x, y, _ = lattice_places(as_points(np.array([c.corners for c in candidates])), rough_lattice(cells))
        height, width = self._least.shape
        row, column = ((at / SCALE).astype(np.int64).clip(0, most - 1) for at, most in ((y, height), (x, width)))
        ratio = min(BLINKING, LEAST_OF_BANDS * self._bright_to_dark(frame, max))
        bands = self._least[row, column] > OCTAVE * math.log2(ratio)
        return [bool(share >= 1 / cells**2) for share in bands.mean(axis=(1, 2))]

    def _blinking(self, frame: Frame, bridge: int) -> list[Pixels]:
        """Outlines of what is bright and dark within every `bridge` rows of each column."""
        ratio = min(BLINKING, max(WALLS, LEAST_OF_BANDS * self._bright_to_dark(frame, min)))
        cv2.LUT(self._half, _octaves(frame.transfer), dst=self._octaves)
        column, lit = np.ones((bridge, 1), np.uint8), self._lit
        cv2.dilate(self._octaves, column, dst=self._most)
        cv2.erode(self._octaves, column, dst=self._least)
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

    def _bright_to_dark(self, frame: Frame, chosen: Callable[[Iterable[float]], float]) -> float:
        """Light of the brightest row over that of the darkest, in the deepest (`max`) or shallowest bands (`min`)."""
        depth = chosen(
            0.5 * shutter.contrast(hz, frame.exposure_us, spec.duty)
            for spec in self._specs
            for hz in (spec.black_hz, spec.white_hz)
        )
        return (1 + depth) / max(1 - depth, 1e-3)

    def _outlines(self) -> list[Pixels]:
        """Of all that is lit, without what hangs on to it by less than a share of its size."""
        cv2.morphologyEx(self._lit, cv2.MORPH_OPEN, np.ones((LEAST_NECK, LEAST_NECK), np.uint8), dst=self._lit)
        found, levels = cv2.findContours(self._lit, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        outlines: list[Pixels] = []
        for outline, level in zip(found, levels[0] if found else (), strict=True):
            x, y, width, height = cv2.boundingRect(outline)
            neck = min(width, height) // NECK
            if level[3] >= 0:  # of a hole; in one of a wall there may be a panel, in its dark frame
                continue
            if neck <= LEAST_NECK:
                outlines.append(outline)
                continue
            filled = np.zeros((height, width), np.uint8)
            cv2.fillPoly(filled, [outline - (x, y)], 255)
            cv2.morphologyEx(filled, cv2.MORPH_OPEN, np.ones((neck, neck), np.uint8), dst=filled)
            parts, _ = cv2.findContours(filled, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=(x, y))
            outlines.extend(parts)
        return outlines

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
        self._hulls.append(hull)
        if not area > MIN_SOLIDITY * of_hull:
            return NOT_FOUR_SIDED
        corners = smallest_square_around(few_corners(hull))
        if corners is None:
            return NOT_FOUR_SIDED
        candidate = self._grown(corners)
        return candidate if candidate.side_px >= self._smallest_px else TOO_SMALL

    def _grown(self, corners: Floats, by: float = 1.0) -> Candidate:
        """The figure with these corners (4, 2), on an outline, in the picture; its sides longer `by` so many pixels.

        An outline runs through the centres of the outermost lit pixels, half a pixel inside the edge.
        """
        side = math.sqrt(float(areas(as_points(corners))))
        middle = corners.mean(axis=0)
        grown = middle + (corners - middle) * (1.0 + by / max(side, 2.0))
        return Candidate(
            corners=(grown + 0.5) * SCALE - 0.5,
            side_px=(side + by) * SCALE,
            tolerance_px=1.5 * SCALE,
        )


def _dark_rows(specs: Sequence[PanelSpec], exposure_us: float, row_time_us: float, contrast: float) -> float:
    """Height of the longest dark band of more than this contrast; 0 where there is none."""
    return max(
        sum(
            (1.0 - spec.duty) / (hz * row_time_us * 1e-6)
            for hz in (spec.black_hz, spec.white_hz)
            if shutter.contrast(hz, exposure_us, spec.duty) > contrast
        )
        for spec in specs
    )


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
