"""The source paper's own method, step by step as in its Figure 7: the baseline that `soft` is measured against.

    (b) the frame, with bands
    (c) binarised against the local mean, so that the bands of each cell become clear
    (d) each band's width in rows measured; its class is that of the nearer expected width
    (e) binarised again, so that a whole marker becomes one white square; the square's four corners
    (f) a cell's size from the square, and a frame one cell wide around it
    (g) the marker restored from the classes of (d), and handed to OpenCV's ArUco detector

It takes picture values as they are, knows of the shutter only how wide the bands are, and of a panel only what one
frame shows. So it reads what a person could read in the picture: deep bands, in cells higher than a band is.

The paper draws its restored frame white and the cells inverted. Here a cell is white where its class is `white_hz`,
which is 1 in OpenCV's word, and the frame is black on white ground, as OpenCV's detector wants them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.decode.cells import unit_square_to
from ledpi.markers import Dictionary, corners_of_turned
from ledpi.records import Floats, Frame, PanelSpec, Pixels, Rejected, Sighting, read_only
from ledpi.shutter import band_width_rows

NO_SQUARE = Rejected(stage="bands", reason="no_square")
NO_BANDS = Rejected(stage="bands", reason="cell_without_bands")
NO_MARKER = Rejected(stage="bands", reason="not_in_dictionary")

# Where the paper is silent:
# (d) Rows in a line of one colour are a band unless much narrower than the narrower band or wider than the wider.
NARROWEST, WIDEST = 0.5, 1.5
# (e) Rooms and panels differ, so "binarised" is at each of these picture values; what is square in any of them counts.
LEVELS = range(32, 255, 28)
WALL_PX = 9  # dark walls between cells that are closed, besides the dark bands
SMALLEST_CELL_PX = 3.0  # less than the narrowest band that can be measured
MIN_FULLNESS = 0.75  # area of an outline over that of its convex hull: a square with some dark bands at its rim
MAX_MISFIT = 0.2  # logarithm of the four-sided polygon's area over the hull's
# (g) A cell is of the class that most of its middle shows, if that is at least so much of it.
INSET, POINTS, CLEAR = 0.2, 12, 0.5
CELL_PX = 10  # of the restored picture
# Rms of a corner's coordinates on simulated panels of 16 cm, 0.4 to 1.6 m away: 2.4 px at 150 µs, where the rim may be
# a dark band, and 1.2 px at 10 ms.
CORNER_SIGMA_PX = 2.4
NO_MARGIN = 0.0  # the method weighs nothing against anything: its answers are as good as a coin's until checked

NO_BAND, BLACK_BAND, WHITE_BAND = 0, 1, 2  # classes of a pixel

Classes = NDArray[np.int8]


@dataclass(frozen=True, slots=True, kw_only=True)
class Square:
    """One white square of (e), and what became of it."""

    corners_px: Floats  # (4, 2) clockwise in the picture, from the one nearest the top left
    framed_px: Floats  # (4, 2) of the frame around it, one cell wide
    cell_px: float  # mean side of a cell
    white_share: Floats  # (n, n) how much of each cell's middle is of class white
    black_share: Floats  # (n, n)
    restored: Pixels | None  # the ArUco picture, None where a cell shows no class
    result: Sighting | Rejected


@dataclass(frozen=True, slots=True, kw_only=True)
class Steps:
    """What each step made of a frame."""

    lit: Pixels  # (H, W), 255 where brighter than the local mean: (c)
    classes: Classes  # (H, W), NO_BAND, BLACK_BAND or WHITE_BAND: (d)
    white: Pixels  # (H, W), 255 within the white squares: (e)
    squares: tuple[Square, ...]  # largest first


class BandsReader:
    """Reads the panels of one pair of frequencies."""

    def __init__(self, dictionary: Dictionary, ids: list[int], spec: PanelSpec) -> None:
        """`ids` of the dictionary have panels of this `spec`."""
        self._cells = dictionary.cells_per_side
        self._ids = ids
        self._spec = spec
        words = [cv2.aruco.Dictionary.getByteListFromBits(w.astype(np.uint8)) for w in dictionary.words[ids]]
        known = cv2.aruco.Dictionary(np.concatenate(words), self._cells, dictionary.correctable_cells())
        self._detector = cv2.aruco.ArucoDetector(known)

    def read(self, frame: Frame) -> Steps:
        """Everything from (c) to (g)."""
        widths = band_widths_rows(frame, self._spec)
        lit = binarise(frame.pixels, widths)
        classes = classify(lit, widths)
        outlines = find_squares(frame.pixels, widths, SMALLEST_CELL_PX * self._cells)
        white = np.zeros_like(frame.pixels)
        cv2.drawContours(white, [outline for outline, _ in outlines], -1, 255, cv2.FILLED)
        squares = tuple(self._read_square(classes, corners) for _, corners in outlines)
        return Steps(lit=lit, classes=classes, white=white, squares=squares)

    def _read_square(self, classes: Classes, corners_px: Floats) -> Square:
        n = self._cells
        to_picture = unit_square_to(corners_px)
        black, white = (class_shares(classes, to_picture, n, kind) for kind in (BLACK_BAND, WHITE_BAND))
        restored, result = None, NO_BANDS
        if np.maximum(black, white).min() >= CLEAR:
            restored = restore(white > black)
            result = self._detect(restored, corners_px)
        sides = np.roll(corners_px, -1, axis=0) - corners_px
        return Square(
            corners_px=read_only(corners_px),
            framed_px=read_only(projected(to_picture, np.array([[-1, -1], [n + 1, -1], [n + 1, n + 1], [-1, n + 1]]) / n)),
            cell_px=float(np.hypot(*sides.T).mean()) / n,
            white_share=read_only(white),
            black_share=read_only(black),
            restored=restored,
            result=result,
        )

    def _detect(self, restored: Pixels, corners_px: Floats) -> Sighting | Rejected:
        """OpenCV's answer. Its first corner is the marker's top left one: it tells how the marker is turned."""
        found, ids, _ = self._detector.detectMarkers(restored)
        frame = CELL_PX * np.array([[1, 1], [1, 0], [0, 0], [0, 1]]) * (self._cells + 2)
        ...
