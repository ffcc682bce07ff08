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
which is 1 in OpenCV's codeword, and the frame is black on white ground, as OpenCV's detector wants them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.core.codewords import Bits, Dictionary, corners_of_turned
from ledpi.core.errors import ConfigError
from ledpi.core.geometry import project_to_quad, square_box
from ledpi.core.records import Detection, Floats, Frame, PanelSpec, Pixels, Rejected, Singles, read_only
from ledpi.core.shutter import band_width_rows

NO_SQUARE = Rejected(stage="uemura", reason="no_square")
NO_BANDS = Rejected(stage="uemura", reason="cell_without_bands")
NO_MARKER = Rejected(stage="uemura", reason="not_in_dictionary")

# Where the paper is silent:
# (d) Rows in a line of one colour are a band unless much narrower than the narrower band or wider than the wider.
NARROWEST, WIDEST = 0.5, 1.5
# (e) Rooms and panels differ, so "binarised" is at each of these picture values; what is square in any of them counts.
LEVELS = range(32, 255, 28)
WALL_PX = 9  # dark walls between cells that are closed, besides the dark bands
MIN_CELL_PX = 3.0  # less than the narrowest band that can be measured
MIN_FULLNESS = 0.75  # area of an outline over that of its convex hull: a square with some dark bands at its rim
MAX_MISFIT = 0.2  # logarithm of the four-sided polygon's area over the hull's
# (g) A cell is of the class that most of its middle shows, if that is at least so much of it.
INSET, POINTS, CLEAR = 0.2, 12, 0.5
CELL_PX = 10  # of the restored picture
# Rms error of a corner's coordinates, on simulated panels of 16 cm, 0.4 to 2 m away: 2.9 px at 135 µs, where the rim
# may be a dark band, whatever the distance; 1.7 px at 10 ms.
CORNER_SIGMA_PX = 2.9
NO_MARGIN = 0.0  # the method weighs its answer against no other: it cannot say how sure it is

NO_BAND, BLACK_BAND, WHITE_BAND = 0, 1, 2  # classes of a pixel

Classes = NDArray[np.int8]


@dataclass(frozen=True, slots=True, kw_only=True)
class Square:
    """One white square of (e), and what became of it."""

    corners_px: Floats  # (4, 2) clockwise in the picture, from the one nearest the top left
    framed_px: Floats  # (4, 2) with the frame around it
    black_share: Floats  # (n, n) how much of each cell's middle is of the black class
    white_share: Floats  # (n, n)
    restored: Pixels | None  # the ArUco picture, None where a cell shows no class
    result: Detection | Rejected


@dataclass(frozen=True, slots=True, kw_only=True)
class Steps:
    """The results of each step on a frame."""

    widths_rows: tuple[float, float]  # expected height of a band of the black class, and of the white one
    lit: Pixels  # (H, W), 255 where brighter than the local mean: (c)
    classes: Classes  # (H, W), NO_BAND, BLACK_BAND or WHITE_BAND: (d)
    white: Pixels  # (H, W), 255 within the white squares, notches filled: (e)
    squares: tuple[Square, ...]  # largest first


class UemuraReader:
    """Reads the panels of one pair of frequencies."""

    def __init__(self, dictionary: Dictionary, ids: list[int], spec: PanelSpec) -> None:
        """`ids`: those of the dictionary whose panels have this `spec`. Raises ConfigError where bands are alike."""
        if spec.phase == "antiphase":
            raise ConfigError(
                "decode.method: uemura distinguishes classes by the height of their bands, and "
                f"at {spec.blinking()} they are alike; must be likelihood"
            )
        self._cells = dictionary.cells_per_side
        self._ids = ids
        self._spec = spec
        codewords = [
            cv2.aruco.Dictionary.getByteListFromBits(codeword.astype(np.uint8))
            for codeword in dictionary.codewords[ids]
        ]
        known = cv2.aruco.Dictionary(np.concatenate(codewords), self._cells, dictionary.correctable_cells())
        self._detector = cv2.aruco.ArucoDetector(known)

    def read(self, frame: Frame) -> Steps:
        """Everything from (c) to (g)."""
        widths = band_widths_rows(frame, self._spec)
        lit = binarise(frame.pixels, widths)
        classes = classify(lit, widths)
        found = find_squares(frame.pixels, widths, MIN_CELL_PX * self._cells)
        white = np.zeros_like(frame.pixels)
        for outline, _ in found:  # one by one: where two overlap, OpenCV leaves a hole
            cv2.fillConvexPoly(white, cv2.convexHull(outline), 255)
        squares = tuple(self._read_square(classes, corners) for _, corners in found)
        return Steps(widths_rows=widths, lit=lit, classes=classes, white=white, squares=squares)

    def _read_square(self, classes: Classes, corners_px: Floats) -> Square:
        black, white = cell_shares(classes, corners_px, self._cells)
        restored: Pixels | None = None
        result: Detection | Rejected = NO_BANDS
        if np.maximum(black, white).min() >= CLEAR:
            restored = restore(white > black)
            result = self._detect(restored, corners_px)
        return Square(
            corners_px=read_only(corners_px),
            framed_px=read_only(add_frame(corners_px, self._cells)),
            black_share=read_only(black),
            white_share=read_only(white),
            restored=restored,
            result=result,
        )

    def _detect(self, restored: Pixels, corners_px: Floats) -> Detection | Rejected:
        """OpenCV's answer, back in the camera's picture: its first corner is the marker's top left one."""
        outlines, ids, _ = self._detector.detectMarkers(restored)
        begin, end = CELL_PX, restored.shape[0] - CELL_PX - 1
        frame = np.array([[begin, begin], [end, begin], [end, end], [begin, end]])
        for outline, index in zip(outlines, [] if ids is None else ids.ravel().tolist(), strict=True):
            away = np.hypot(*(frame - outline.reshape(4, 2)[0]).T)
            turns = int(np.argmin(away))
            if away[turns] < CELL_PX / 2:  # else it is something within the marker
                return Detection(
                    id=self._ids[index],
                    corners_px=read_only(corners_of_turned(corners_px, turns)),
                    covariance_px2=CORNER_SIGMA_PX**2 * np.eye(8),
                    margin=NO_MARGIN,
                    frames_used=1,
                )
        return NO_MARKER


def band_widths_rows(frame: Frame, spec: PanelSpec) -> tuple[float, float]:
    """Expected height of a band of the black class and of the white one."""
    rows = frame.pixels.shape[0]
    scan_time_s = rows * abs(frame.row_time_us) * 1e-6
    black, white = (band_width_rows(hz, rows=rows, scan_time_s=scan_time_s) for hz in (spec.black_hz, spec.white_hz))
    return black, white


def binarise(pixels: Pixels, widths: tuple[float, float]) -> Pixels:
    """(H, W), 255 where a pixel is brighter than the local mean, else 0: step (c)."""
    return np.asarray(cv2.compare(pixels.astype(np.float32), local_mean(pixels, widths), cv2.CMP_GT), np.uint8)


def local_mean(pixels: Pixels, widths: tuple[float, float]) -> Singles:
    """(H, W) mean over the pixels above and below.

    The paper is silent on how far. One period of the wider bands, so that these leave the mean even; of one column, as
    the cells to either side have bands of their own.
    """
    period = min(round(2 * max(widths)), pixels.shape[0] - 1) | 1
    return np.asarray(cv2.boxFilter(pixels, cv2.CV_32F, (1, period)), np.float32)


def classify(lit: Pixels, widths: tuple[float, float]) -> Classes:
    """(H, W) class of the band, bright or dark, that each pixel of `lit` lies in, column by column: step (d).

    A band's width is the number of its rows, and the class that whose width is nearer.
    """
    black, white = widths
    columns = np.ascontiguousarray(lit.T)
    begins = np.ones(columns.shape, bool)
    begins[:, 1:] = columns[:, 1:] != columns[:, :-1]
    first = np.flatnonzero(begins)
    rows = np.diff(first, append=columns.size)
    nearer = np.where(np.abs(rows - white) < np.abs(rows - black), WHITE_BAND, BLACK_BAND)
    is_band = (rows >= NARROWEST * min(widths)) & (rows <= WIDEST * max(widths))
    bands = np.where(is_band, nearer, NO_BAND).astype(np.int8)
    return np.ascontiguousarray(np.repeat(bands, rows).reshape(columns.shape).T)


def find_squares(pixels: Pixels, widths: tuple[float, float], smallest_px: float) -> list[tuple[Pixels, Floats]]:
    """Outline (N, 1, 2) and corners (4, 2) of what is one white square once the dark bands are closed: step (e).

    Largest first; of squares at one place, the one that is most nearly four-sided. A dark band may be as high as one of
    each class together, where a cell of the one stands on a cell of the other.
    """
    closed = cv2.morphologyEx(pixels, cv2.MORPH_CLOSE, np.ones((math.ceil(sum(widths)) | 1, WALL_PX), np.uint8))
    found: list[tuple[float, Pixels, Floats]] = []
    for level in LEVELS:
        white = cv2.threshold(closed, level, 255, cv2.THRESH_BINARY)[1]
        for outline in cv2.findContours(white, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]:
            fitted = _four_corners(outline, smallest_px, white.shape)
            if fitted is not None:
                corners, misfit = fitted
                found.append((misfit, outline, corners))
    kept: list[tuple[Pixels, Floats]] = []
    for _, outline, corners in sorted(found, key=lambda f: f[0]):
        if not any(_same_place(corners, other) for _, other in kept):
            kept.append((outline, corners))
    return sorted(kept, key=lambda f: -cv2.contourArea(f[0]))


def _four_corners(outline: Pixels, smallest_px: float, shape: tuple[int, ...]) -> tuple[Floats, float] | None:
    """Corners of an outline and how badly they fit it, None where it is no square or not wholly in the picture."""
    x, y, width, height = cv2.boundingRect(outline)
    if min(width, height) < smallest_px or x == 0 or y == 0 or x + width == shape[1] or y + height == shape[0]:
        return None
    hull = cv2.convexHull(outline)
    area = cv2.contourArea(hull)
    if cv2.contourArea(outline) < MIN_FULLNESS * area:
        return None
    length = cv2.arcLength(hull, True)
    polygons = (cv2.approxPolyDP(hull, share * length, True) for share in (0.02, 0.03, 0.05, 0.07, 0.1))
    polygon = next((p for p in polygons if len(p) <= 4), None)
    if polygon is None or len(polygon) < 4:
        return None
    corners = polygon.reshape(4, 2).astype(np.float64)
    misfit = abs(math.log(max(cv2.contourArea(polygon), 1e-3) / area))
    if misfit > MAX_MISFIT:
        return None
    # An outline runs through the centres of the outermost white pixels, half a pixel inside the edge.
    centre = corners.mean(axis=0)
    grown = centre + (corners - centre) * (1 + 1 / math.sqrt(area))
    return np.roll(grown, -int(np.argmin(grown.sum(axis=1))), axis=0), misfit


def _same_place(a: Floats, b: Floats) -> bool:
    """Tells whether two squares have about one centre and one size."""
    sides = sorted(math.sqrt(cv2.contourArea(c.astype(np.float32))) for c in (a, b))
    apart = float(np.hypot(*(a.mean(axis=0) - b.mean(axis=0))))
    return apart < 0.25 * sides[1] and sides[0] > 0.7 * sides[1]


def add_frame(corners_px: Floats, cells: int) -> Floats:
    """(4, 2) corners of a square of `cells` × `cells`, with one cell more on every side, in perspective: step (f)."""
    return project_to_quad(corners_px, square_box(-1, cells + 1) / cells)


def cell_shares(classes: Classes, corners_px: Floats, cells: int) -> tuple[Floats, Floats]:
    """(n, n) shares of each cell's middle that lie in bands of the black class and of the white one."""
    inside = INSET + (np.arange(POINTS) + 0.5) / POINTS * (1 - 2 * INSET)
    along = ((np.arange(cells)[:, None] + inside) / cells).ravel()
    u, v = np.meshgrid(along, along)
    at = project_to_quad(corners_px, np.column_stack([u.ravel(), v.ravel()])).astype(np.float32)
    seen = cv2.remap(classes.view(np.uint8), at[None], None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)
    by_cell = seen.reshape(cells, POINTS, cells, POINTS)
    return (by_cell == BLACK_BAND).mean(axis=(1, 3)), (by_cell == WHITE_BAND).mean(axis=(1, 3))


def restore(codeword: Bits) -> Pixels:
    """The ArUco picture of a codeword: the cells, a black frame one cell wide, and white ground around it: step (g)."""
    framed = np.pad(np.pad(codeword, 1, constant_values=False), 1, constant_values=True)
    return np.kron(framed, np.full((CELL_PX, CELL_PX), 255)).astype(np.uint8)
