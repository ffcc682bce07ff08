"""The steps of a method, drawn: how a frame was read, as pictures in rows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from ledpi.core.codewords import Bits
from ledpi.core.geometry import first_at_top_left, unit_square_homography
from ledpi.core.records import Detection, Floats, Pixels, Rejected
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.decision import Reading
from ledpi.decode.uemura import BLACK_BAND, CELL_PX, WHITE_BAND, Square, Steps, local_mean
from ledpi.pipeline.diagnosis import drawing
from ledpi.pipeline.trace import SquareTrace, class_alone, class_given_others
from ledpi.workshop.snapshot.page import (
    BORDER,
    PICTURES_TOP,
    WIDTH,
    View,
    bands_tile,
    blank,
    cells_tile,
    draw_heading,
    view_of,
)
from ledpi.workshop.snapshot.sources import Snapshot

GAP = 16

MAX_SQUARES = 3
FULL_COLOUR_NATS = 7.0  # odds of a thousand to one
FRAME = (80, 210, 80)  # green, as in the paper
DARK_BAND = 0.45  # of its class's colour, which a bright band has
MAX_LINES = 7
TITLE, CAPTION = 30, 30  # heights of the lines above a row, and below its tiles


@dataclass(frozen=True, slots=True, kw_only=True)
class Tile:
    """A picture with the line below it."""

    label: str  # as `drawing.text` can
    picture: drawing.Canvas


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """Tiles side by side, under a line."""

    title: str  # as `drawing.text` can
    tiles: tuple[Tile, ...]


def tile_width(tiles: int) -> int:
    """Returns that of so many in a row."""
    return (WIDTH - 2 * BORDER - (tiles - 1) * GAP) // tiles


def likelihood_rows(snapshot: Snapshot) -> list[Row]:
    """The frame and its candidates; then a row for each square, those that were read first, then the largest."""
    squares = sorted(snapshot.trace.squares, key=lambda square: (isinstance(square.reading, Reading), _area(square)))
    return [_found(snapshot), *(_row(square, snapshot) for square in squares[: -MAX_SQUARES - 1 : -1])]


def _area(square: SquareTrace) -> float:
    return float(cv2.contourArea(square.quad.corners_px.astype(np.float32)))


def _found(snapshot: Snapshot) -> Row:
    view = view_of([], snapshot.frame.pixels.shape, tile_width(2))
    seen, found = view.crop(snapshot.frame.pixels), view.crop(snapshot.frame.pixels)
    for candidate in snapshot.trace.candidates:
        drawing.outline(found, view.place(candidate.corners_px), drawing.DROPPED, 1)
    for square in snapshot.trace.squares:
        drawing.outline(found, view.place(square.quad.corners_px), drawing.TEXT, 2)
    count = f"candidates: {len(snapshot.trace.candidates)}, squares: {len(snapshot.trace.squares)}"
    return Row(title="Where panels may be", tiles=(Tile(label="frame", picture=seen), Tile(label=count, picture=found)))


def _row(square: SquareTrace, snapshot: Snapshot) -> Row:
    """All tiles upright as in the frame, with whichever corner the quad begins."""
    size, reading, turns = tile_width(4), square.reading, first_at_top_left(square.quad.corners_px)
    n, covariance = square.samples.lattice.cells, square.quad.covariance_px2
    sigma = "" if covariance is None else f", ±{math.sqrt(np.trace(covariance) / 8):.2f} px"
    bands, share = bands_tile(square.samples, size)
    tiles = [
        Tile(label=f"refined square{sigma}", picture=_refined(square, snapshot, size)),
        Tile(label=f"its bands: ±{100 * share:.1f} %", picture=np.ascontiguousarray(np.rot90(bands, turns))),
    ]
    if not isinstance(reading, Reading):
        if isinstance(square.evidence, Evidence) and len(square.evidence.prior) == 4:  # in antiphase none says it alone
            nats = np.rot90(class_alone(square.evidence).reshape(n, n), turns)
            tiles.append(Tile(label="evidence in nats, each cell alone", picture=_evidence(nats, size)))
        return Row(title=reading.key, tiles=tuple(tiles))
    codeword: Bits = np.rot90(snapshot.panels.words.codeword(reading.id), -reading.quarter_turns)
    if isinstance(square.evidence, Evidence):
        nats = class_given_others(square.evidence, reading.cell_bands, codeword.ravel()).reshape(n, n)
        picture = _evidence(np.rot90(nats, turns), size)
        tiles.append(Tile(label="evidence in nats, given the other cells", picture=picture))
    tiles.append(
        Tile(label=f"codeword of ID {reading.id}, as seen", picture=cells_tile(np.rot90(codeword, turns), size))
    )
    depth = " and ".join(f"{100 * a:.1f} %" for a in reading.amplitude)
    return Row(title=f"ID {reading.id}   margin {reading.margin:.0f}   bands of {depth}", tiles=tuple(tiles))


def _refined(square: SquareTrace, snapshot: Snapshot, size: int) -> drawing.Canvas:
    """The square and a little around it, upright as in the frame."""
    low, high = square.quad.corners_px.min(axis=0), square.quad.corners_px.max(axis=0)
    scale = size / (1.3 * float((high - low).max()))
    shift = size / 2 - scale * (low + high) / 2
    move = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    tile = cv2.warpAffine(snapshot.frame.pixels, move, (size, size), flags=cv2.INTER_NEAREST)
    tile = np.asarray(cv2.cvtColor(tile, cv2.COLOR_GRAY2BGR), np.uint8)
    drawing.outline(tile, square.quad.corners_px * scale + shift, drawing.DROPPED, 1)
    return tile


def _evidence(nats: Floats, size: int) -> drawing.Canvas:
    """Each cell in the colour of the class that it speaks for, the stronger the more it says."""
    tile = blank(size)
    n = len(nats)
    pitch, wall = size / n, (1 - drawing.CELL_SHARE) / 2
    for (row, column), value in np.ndenumerate(nats):
        top, left = (round((c + wall) * pitch) for c in (row, column))
        bottom, right = (round((c + 1 - wall) * pitch) for c in (row, column))
        strength = min(1.0, abs(value) / FULL_COLOUR_NATS)
        colour = np.array(drawing.WHITE_CLASS if value > 0 else drawing.BLACK_CLASS)
        tile[top:bottom, left:right] = strength * colour + (1 - strength) * np.array(drawing.BACKGROUND)
        label = f"{abs(value):.0f}"
        width, height = drawing.text_size(label, bold=True)
        at = (left + right - width) // 2, (top + bottom + height) // 2
        drawing.text(tile, label, at, colour=drawing.BACKGROUND if strength > 0.5 else drawing.TEXT, bold=True)
    return tile


def uemura_rows(snapshot: Snapshot) -> list[Row]:
    """(a) to (d), and (e) to (g) with what came of it; around the panels that were read, else around all squares."""
    frame = snapshot.frame
    # The squares by the pair of frequencies under which most was read.
    steps = max(snapshot.trace.uemura, key=lambda of: sum(isinstance(s.result, Detection) for s in of.squares))
    averaged = np.round(local_mean(frame.pixels, steps.widths_rows)).astype(np.uint8)
    read = [square.framed_px for square in steps.squares if isinstance(square.result, Detection)]
    squares = [square.framed_px for square in steps.squares]
    view = view_of(read or squares, frame.pixels.shape, tile_width(4))
    black, white = steps.widths_rows
    return [
        Row(
            title="From the frame to the class of each band",
            tiles=(
                Tile(label="(a) to the eye: bands averaged", picture=view.crop(averaged)),
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


def _classes(steps: Steps) -> drawing.Canvas:
    coloured = np.full((*steps.classes.shape, 3), drawing.BACKGROUND, np.uint8)
    for kind, colour in ((BLACK_BAND, drawing.BLACK_CLASS), (WHITE_BAND, drawing.WHITE_CLASS)):
        of_kind = steps.classes == kind
        coloured[of_kind & (steps.lit > 0)] = colour
        coloured[of_kind & (steps.lit == 0)] = np.array(colour) * DARK_BAND
    return coloured


def _squares(view: View, steps: Steps) -> drawing.Canvas:
    tile = view.crop(steps.white)
    for square in steps.squares:
        for x, y in view.place(square.corners_px).round().astype(int).tolist():
            cv2.circle(tile, (x, y), 3, drawing.DROPPED, cv2.FILLED, cv2.LINE_AA)
    return tile


def _framed(view: View, pixels: Pixels, steps: Steps) -> drawing.Canvas:
    tile = view.crop(pixels)
    for square in steps.squares:
        inner, outer = (view.place(c).round().astype(np.int32) for c in (square.corners_px, square.framed_px))
        cv2.fillPoly(tile, [outer, inner], FRAME, cv2.LINE_AA)  # what lies within both is left as it is
    return tile


def _restored(view: View, steps: Steps) -> drawing.Canvas:
    """Each restored picture, its ground included, where its square is in the frame."""
    tile = np.full((view.height, view.width, 3), drawing.BACKGROUND, np.uint8)
    for square in steps.squares:
        if square.restored is None:
            drawing.outline(tile, view.place(square.corners_px), drawing.DIM, 1)
            continue
        n, size = len(square.white_share), square.restored.shape[0]
        # A pixel's centre, in cells from the left of the ground, which begins two cells before the square.
        to_square = np.array([[1, 0, 0.5 - 2 * CELL_PX], [0, 1, 0.5 - 2 * CELL_PX], [0, 0, n * CELL_PX]]) / CELL_PX
        way = view.matrix() @ unit_square_homography(square.corners_px) @ to_square
        cover = cv2.warpPerspective(np.full((size, size), 255, np.uint8), way, (view.width, view.height))
        there = cv2.warpPerspective(square.restored, way, (view.width, view.height))
        tile[cover > 127] = there[cover > 127][:, None]
    return tile


def _results(view: View, steps: Steps) -> drawing.Canvas:
    tile = np.full((view.height, view.width, 3), drawing.BACKGROUND, np.uint8)
    lines = [_result(square) for square in steps.squares] or ["no square"]
    for index, words in enumerate(lines[:MAX_LINES]):
        drawing.text(
            tile, words, (4, 24 + 24 * index), colour=drawing.TEXT if words.startswith("ID") else drawing.DROPPED
        )
    if len(lines) > MAX_LINES:
        drawing.text(tile, f"and {len(lines) - MAX_LINES} more squares", (4, 24 + 24 * MAX_LINES), colour=drawing.DIM)
    return tile


def _result(square: Square) -> str:
    return square.result.reason if isinstance(square.result, Rejected) else f"ID {square.result.id}"


def draw_steps(snapshot: Snapshot) -> Pixels:
    """(height, WIDTH, 3), BGR: the rows of tiles of the method that decoded the frame."""
    rows = uemura_rows(snapshot) if snapshot.trace.uemura else likelihood_rows(snapshot)
    top = PICTURES_TOP - TITLE
    height = top + sum(_height(row) for row in rows) + BORDER // 2
    canvas = np.full((height, WIDTH, 3), drawing.BACKGROUND, np.uint8)
    draw_heading(canvas, snapshot)
    for row in rows:
        drawing.text(canvas, row.title, (BORDER, top + TITLE - 10), bold=True)
        left = BORDER
        for tile in row.tiles:
            tall, wide = tile.picture.shape[:2]
            canvas[top + TITLE : top + TITLE + tall, left : left + wide] = tile.picture
            drawing.text(canvas, tile.label, (left, top + TITLE + tall + 19), size=0.42, colour=drawing.DIM)
            left += wide + GAP
        top += _height(row)
    return canvas


def _height(row: Row) -> int:
    tallest: int = max(tile.picture.shape[0] for tile in row.tiles)
    return TITLE + tallest + CAPTION
