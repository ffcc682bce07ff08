"""The steps of `soft`: frame, candidates, and of each square its light, bands, evidence and word."""

from __future__ import annotations

import cv2
import numpy as np

from ledpi.core.geometry import first_at_top_left
from ledpi.core.records import Floats
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.each_cell import alone_for_white, given_others_for_white
from ledpi.decode.identify.soft import Reading
from ledpi.markers.words import Bits
from ledpi.pipeline.trace import Look
from ledpi.tools.snapshot.drawing import (
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
from ledpi.tools.snapshot.enlarged import bands_tile, blank, cells_tile
from ledpi.tools.snapshot.record import Snapshot
from ledpi.tools.snapshot.tiles import Row, Tile, tile_width, view_of

MOST_LOOKS = 3
FULL_COLOUR_NATS = 7.0  # odds of a thousand to one


def soft_rows(snapshot: Snapshot) -> list[Row]:
    """The frame and its candidates; then a row for each square, those that were read first, then the largest."""
    looks = sorted(snapshot.trace.looks, key=lambda look: (isinstance(look.reading, Reading), _area(look)))
    return [_found(snapshot), *(_row(look, snapshot) for look in looks[: -MOST_LOOKS - 1 : -1])]


def _area(look: Look) -> float:
    return float(cv2.contourArea(look.quad.corners_px.astype(np.float32)))


def _found(snapshot: Snapshot) -> Row:
    view = view_of([], snapshot.frame.pixels.shape, tile_width(2))
    seen, found = view.of(snapshot.frame.pixels), view.of(snapshot.frame.pixels)
    for candidate in snapshot.trace.candidates:
        outline(found, view.place(candidate.corners_px), DROPPED, 1)
    for look in snapshot.trace.looks:
        outline(found, view.place(look.quad.corners_px), TEXT, 2)
    count = f"candidates: {len(snapshot.trace.candidates)}, squares: {len(snapshot.trace.looks)}"
    return Row(title="Where panels may be", tiles=(Tile(label="frame", picture=seen), Tile(label=count, picture=found)))


def _row(look: Look, snapshot: Snapshot) -> Row:
    """All tiles upright as in the frame, with whichever corner the quad begins."""
    size, reading, turns = tile_width(4), look.reading, first_at_top_left(look.quad.corners_px)
    n = look.samples.lattice.cells
    bands, share = bands_tile(look.samples, size)
    tiles = [
        Tile(label=f"refined square, ±{look.quad.corner_sigma_px:.2f} px", picture=_refined(look, snapshot, size)),
        Tile(label=f"its bands: ±{100 * share:.1f} %", picture=np.ascontiguousarray(np.rot90(bands, turns))),
    ]
    if not isinstance(reading, Reading):
        if isinstance(look.evidence, Evidence) and len(look.evidence.prior) == 4:  # in antiphase none says it alone
            nats = np.rot90(alone_for_white(look.evidence).reshape(n, n), turns)
            tiles.append(Tile(label="evidence in nats, each cell alone", picture=_evidence(nats, size)))
        return Row(title=reading.key, tiles=tuple(tiles))
    word: Bits = np.rot90(snapshot.word(reading.id), -reading.quarter_turns)
    if isinstance(look.evidence, Evidence):
        nats = given_others_for_white(look.evidence, reading.cell_bands, word.ravel()).reshape(n, n)
        picture = _evidence(np.rot90(nats, turns), size)
        tiles.append(Tile(label="evidence in nats, given the other cells", picture=picture))
    tiles.append(Tile(label=f"word of ID {reading.id}, as seen", picture=cells_tile(np.rot90(word, turns), size)))
    depth = " and ".join(f"{100 * a:.1f} %" for a in reading.amplitude)
    return Row(title=f"ID {reading.id}   margin {reading.margin:.0f}   bands of {depth}", tiles=tuple(tiles))


def _refined(look: Look, snapshot: Snapshot, size: int) -> Canvas:
    """The square and a little around it, upright as in the frame."""
    low, high = look.quad.corners_px.min(axis=0), look.quad.corners_px.max(axis=0)
    scale = size / (1.3 * float((high - low).max()))
    shift = size / 2 - scale * (low + high) / 2
    move = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    tile = cv2.warpAffine(snapshot.frame.pixels, move, (size, size), flags=cv2.INTER_NEAREST)
    tile = np.asarray(cv2.cvtColor(tile, cv2.COLOR_GRAY2BGR), np.uint8)
    outline(tile, look.quad.corners_px * scale + shift, DROPPED, 1)
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
