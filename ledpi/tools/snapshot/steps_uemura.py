"""The steps of `uemura`, lettered as in the source paper's Figure 7."""

from __future__ import annotations

import cv2
import numpy as np

from ledpi.core.geometry import unit_square_homography
from ledpi.core.records import Detection, Pixels, Rejected
from ledpi.diagnosis.drawing import BACKGROUND, BLACK_CLASS, DIM, DROPPED, TEXT, WHITE_CLASS, Canvas, outline, text
from ledpi.tools.snapshot.record import Snapshot
from ledpi.tools.snapshot.tiles import Row, Tile, View, tile_width, view_of
from ledpi.uemura.reader import BLACK_BAND, CELL_PX, WHITE_BAND, Square, Steps, local_mean

FRAME = (80, 210, 80)  # green, as in the paper
DARK_BAND = 0.45  # of its class's colour, which a bright band has
MAX_LINES = 7


def uemura_rows(snapshot: Snapshot) -> list[Row]:
    """(a) to (d), and (e) to (g) with what came of it; around the panels that were read, else around all squares."""
    frame = snapshot.frame
    steps = _most_telling(snapshot.trace.uemura)
    read = [square.framed_px for square in steps.squares if isinstance(square.result, Detection)]
    squares = [square.framed_px for square in steps.squares]
    view = view_of(read or squares, frame.pixels.shape, tile_width(4))
    black, white = steps.widths_rows
    return [
        Row(
            title="From the frame to the class of each band",
            tiles=(
                Tile(label="(a) to the eye: bands averaged", picture=view.crop(_average_bands(frame.pixels, steps))),
                Tile(label="(b) as captured", picture=view.crop(frame.pixels)),
                Tile(label="(c) brighter than the local mean", picture=view.crop(steps.lit)),
                Tile(label=f"(d) nearer {black:.1f} rows, or {white:.1f}", picture=view.crop(_classes(steps))),
            ),
        ),
        Row(
            title="From the squares to the marker",
            tiles=(
                Tile(label="(e) white squares, their corners", picture=_squares(view, steps)),
                Tile(label="(f) a frame one cell wide", picture=_framed(view, frame.pixels, steps)),
                Tile(label="(g) restored, for OpenCV's detector", picture=_restored(view, steps)),
                Tile(label="", picture=_results(view, steps)),
            ),
        ),
    ]


def _most_telling(of_each_pair: list[Steps]) -> Steps:
    """The steps for the pair of frequencies under which most was read."""
    return max(of_each_pair, key=lambda steps: sum(isinstance(s.result, Detection) for s in steps.squares))


def _average_bands(pixels: Pixels, steps: Steps) -> Pixels:
    return np.round(local_mean(pixels, steps.widths_rows)).astype(np.uint8)


def _classes(steps: Steps) -> Canvas:
    coloured = np.full((*steps.classes.shape, 3), BACKGROUND, np.uint8)
    for kind, colour in ((BLACK_BAND, BLACK_CLASS), (WHITE_BAND, WHITE_CLASS)):
        of_kind = steps.classes == kind
        coloured[of_kind & (steps.lit > 0)] = colour
        coloured[of_kind & (steps.lit == 0)] = np.array(colour) * DARK_BAND
    return coloured


def _squares(view: View, steps: Steps) -> Canvas:
    tile = view.crop(steps.white)
    for square in steps.squares:
        for x, y in view.place(square.corners_px).round().astype(int).tolist():
            cv2.circle(tile, (x, y), 3, DROPPED, cv2.FILLED, cv2.LINE_AA)
    return tile


def _framed(view: View, pixels: Pixels, steps: Steps) -> Canvas:
    tile = view.crop(pixels)
    for square in steps.squares:
        inner, outer = (view.place(c).round().astype(np.int32) for c in (square.corners_px, square.framed_px))
        cv2.fillPoly(tile, [outer, inner], FRAME, cv2.LINE_AA)  # what lies within both is left as it is
    return tile


def _restored(view: View, steps: Steps) -> Canvas:
    """Each restored picture, its ground included, where its square is in the frame."""
    tile = np.full((view.height, view.width, 3), BACKGROUND, np.uint8)
    for square in steps.squares:
        if square.restored is None:
            outline(tile, view.place(square.corners_px), DIM, 1)
            continue
        n, size = len(square.white_share), square.restored.shape[0]
        # A pixel's centre, in cells from the left of the ground, which begins two cells before the square.
        to_square = np.array([[1, 0, 0.5 - 2 * CELL_PX], [0, 1, 0.5 - 2 * CELL_PX], [0, 0, n * CELL_PX]]) / CELL_PX
        way = view.matrix() @ unit_square_homography(square.corners_px) @ to_square
        cover = cv2.warpPerspective(np.full((size, size), 255, np.uint8), way, (view.width, view.height))
        there = cv2.warpPerspective(square.restored, way, (view.width, view.height))
        tile[cover > 127] = there[cover > 127][:, None]
    return tile


def _results(view: View, steps: Steps) -> Canvas:
    tile = np.full((view.height, view.width, 3), BACKGROUND, np.uint8)
    lines = [_result(square) for square in steps.squares] or ["no square"]
    for index, words in enumerate(lines[:MAX_LINES]):
        text(tile, words, (4, 24 + 24 * index), colour=TEXT if words.startswith("ID") else DROPPED)
    if len(lines) > MAX_LINES:
        text(tile, f"and {len(lines) - MAX_LINES} more squares", (4, 24 + 24 * MAX_LINES), colour=DIM)
    return tile


def _result(square: Square) -> str:
    return square.result.reason if isinstance(square.result, Rejected) else f"ID {square.result.id}"
