"""The steps of `likelihood`: frame, candidates, and for each square its light, bands, evidence and codeword."""

from __future__ import annotations

import math

import cv2
import numpy as np

from ledpi.core.geometry import first_at_top_left
from ledpi.core.records import Floats
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.decision import Reading
from ledpi.diagnosis.drawing import (
    BACKGROUND,
    BLACK_CLASS,
    CELL_SHARE,
    DROPPED,
    TEXT,
    WHITE_CLASS,
    Canvas,
    outline,
    text,
    text_size,
)
from ledpi.markers.codewords import Bits
from ledpi.pipeline.each_cell import class_alone, class_given_others
from ledpi.pipeline.trace import SquareTrace
from ledpi.tools.snapshot.enlarged import bands_tile, blank, cells_tile
from ledpi.tools.snapshot.record import Snapshot
from ledpi.tools.snapshot.tiles import Row, Tile, tile_width, view_of

MAX_SQUARES = 3
FULL_COLOUR_NATS = 7.0  # odds of a thousand to one


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
        outline(found, view.place(candidate.corners_px), DROPPED, 1)
    for square in snapshot.trace.squares:
        outline(found, view.place(square.quad.corners_px), TEXT, 2)
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
    codeword: Bits = np.rot90(snapshot.codeword(reading.id), -reading.quarter_turns)
    if isinstance(square.evidence, Evidence):
        nats = class_given_others(square.evidence, reading.cell_bands, codeword.ravel()).reshape(n, n)
        picture = _evidence(np.rot90(nats, turns), size)
        tiles.append(Tile(label="evidence in nats, given the other cells", picture=picture))
    tiles.append(
        Tile(label=f"codeword of ID {reading.id}, as seen", picture=cells_tile(np.rot90(codeword, turns), size))
    )
    depth = " and ".join(f"{100 * a:.1f} %" for a in reading.amplitude)
    return Row(title=f"ID {reading.id}   margin {reading.margin:.0f}   bands of {depth}", tiles=tuple(tiles))


def _refined(square: SquareTrace, snapshot: Snapshot, size: int) -> Canvas:
    """The square and a little around it, upright as in the frame."""
    low, high = square.quad.corners_px.min(axis=0), square.quad.corners_px.max(axis=0)
    scale = size / (1.3 * float((high - low).max()))
    shift = size / 2 - scale * (low + high) / 2
    move = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    tile = cv2.warpAffine(snapshot.frame.pixels, move, (size, size), flags=cv2.INTER_NEAREST)
    tile = np.asarray(cv2.cvtColor(tile, cv2.COLOR_GRAY2BGR), np.uint8)
    outline(tile, square.quad.corners_px * scale + shift, DROPPED, 1)
    return tile


def _evidence(nats: Floats, size: int) -> Canvas:
    """Each cell in the colour of the class that it speaks for, the stronger the more it says."""
    tile = blank(size)
    n = len(nats)
    pitch, wall = size / n, (1 - CELL_SHARE) / 2
    for (row, column), value in np.ndenumerate(nats):
        top, left = (round((c + wall) * pitch) for c in (row, column))
        bottom, right = (round((c + 1 - wall) * pitch) for c in (row, column))
        strength = min(1.0, abs(value) / FULL_COLOUR_NATS)
        colour = np.array(WHITE_CLASS if value > 0 else BLACK_CLASS)
        tile[top:bottom, left:right] = strength * colour + (1 - strength) * np.array(BACKGROUND)
        label = f"{abs(value):.0f}"
        width, height = text_size(label, bold=True)
        at = (left + right - width) // 2, (top + bottom + height) // 2
        text(tile, label, at, colour=BACKGROUND if strength > 0.5 else TEXT, bold=True)
    return tile
