"""One panel, enlarged and upright, in three tiles: as seen, its bands amplified, its cells."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ledpi.core.codewords import Bits
from ledpi.core.geometry import first_at_top_left
from ledpi.core.records import Floats, Frame, MarkerPose, Pixels, Quad, Rejected
from ledpi.decode.evidence.cells import CellSamples, sample_cells
from ledpi.pipeline.diagnosis.diagnose import Diagnosis
from ledpi.pipeline.diagnosis.drawing import (
    BACKGROUND,
    CELL_SHARE,
    DIM,
    DROPPED,
    TEXT,
    Canvas,
    ascii_of,
    draw_cells,
    text,
    text_size,
)
from ledpi.workshop.snapshot.record import Snapshot

TILE, GAP = 180, 15
TITLE, CAPTION = 26, 24  # heights of the lines above and below the tiles
HEIGHT = TITLE + TILE + CAPTION
CLIPPED_PERCENT = 2.0  # of the amplified samples, which may be lost in black or white
AVERAGED = 3  # neighbouring samples along the picture's rows: a row has one exposure


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """A panel, or what nearly was one, with its title."""

    corners_px: Floats  # (4, 2) of the marker, or as the picture shows it
    title: str
    codeword: Bits | None  # upright; None where none was read


def blocks_of(snapshot: Snapshot, told: list[Diagnosis]) -> list[Block]:
    """The panels, surest first, then what is told of and not read."""
    blocks = []
    for marker in sorted(snapshot.decoded.markers, key=lambda m: -m.detection.margin):
        detection = marker.detection
        title = f"ID {detection.id}   {_place(marker)}   margin {detection.margin:.0f}"
        blocks.append(Block(corners_px=detection.corners_px, title=title, codeword=snapshot.codeword(detection.id)))
    for number, one in enumerate(told, 1):
        corners = np.roll(one.corners_px, -first_at_top_left(one.corners_px), axis=0)
        blocks.append(Block(corners_px=corners, title=f"{number}   {ascii_of(one.says)}", codeword=None))
    return blocks


def _place(marker: MarkerPose) -> str:
    if marker.solution is None:
        return "no pose"
    x, y, z = marker.solution.camera_from_marker.position_m
    return f"x {x:+.3f}  y {y:+.3f}  z {z:.3f} m"


def draw_block(canvas: Canvas, block: Block, snapshot: Snapshot) -> None:
    """Fills `canvas`, HEIGHT high."""
    text(canvas, block.title, (0, TITLE - 9), colour=DROPPED if block.codeword is None else TEXT, bold=True)
    samples = _samples(block, snapshot)
    sampled = isinstance(samples, CellSamples)
    bands, share = bands_tile(samples) if isinstance(samples, CellSamples) else (blank(TILE), 0.0)
    tiles = (
        (_seen_tile(block, snapshot.frame), "as seen"),
        (bands, f"bands: ±{100 * share:.1f} %" if sampled else "cells cannot be sampled"),
        (cells_tile(block.codeword), "cells") if block.codeword is not None else (blank(TILE), ""),
    )
    for index, (tile, caption) in enumerate(tiles):
        x = index * (TILE + GAP)
        canvas[TITLE : TITLE + TILE, x : x + TILE] = tile
        text(canvas, caption, (x, TITLE + TILE + 17), size=0.42, colour=DIM)


def blank(size: int) -> Pixels:
    """An empty tile."""
    return np.full((size, size, 3), BACKGROUND, np.uint8)


def _seen_tile(block: Block, frame: Frame) -> Pixels:
    # Pixel centres have whole numbers, so a tile reaches half a pixel beyond its first and its last one.
    square = np.array([[0, 0], [TILE, 0], [TILE, TILE], [0, TILE]], np.float32) - np.float32(0.5)
    warp = cv2.getPerspectiveTransform(block.corners_px.astype(np.float32), square)
    tile = cv2.warpPerspective(frame.pixels, warp, (TILE, TILE), borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(cv2.cvtColor(tile, cv2.COLOR_GRAY2BGR), np.uint8)


def _samples(block: Block, snapshot: Snapshot) -> CellSamples | Rejected:
    n = snapshot.panels.words.cells_per_side
    quad = Quad(corners_px=block.corners_px)
    return sample_cells(snapshot.frame, quad, n, snapshot.intrinsics)


def bands_tile(samples: CellSamples, size: int = TILE) -> tuple[Pixels, float]:
    """The light of every cell over what it would be without bands; and how much more or less is white or black."""
    tile, n = blank(size), samples.lattice.cells
    bands = _averaged_along_rows(bands_of(samples), samples)
    share = float(np.percentile(np.abs(bands), 100 - CLIPPED_PERCENT)) or 1.0
    grey = np.clip(127.5 * (1 + bands / share), 0, 255).astype(np.uint8)
    pitch, wall = size / n, (1 - CELL_SHARE) / 2
    for cell, light in enumerate(grey):
        top, left = (round((c + wall) * pitch) for c in divmod(cell, n))
        bottom, right = (round((c + 1 - wall) * pitch) for c in divmod(cell, n))
        enlarged = cv2.resize(light, (right - left, bottom - top), interpolation=cv2.INTER_LINEAR)
        tile[top:bottom, left:right] = enlarged[..., None]
    return tile, share


def bands_of(samples: CellSamples) -> Floats:
    """(cells, points) light over the static picture, less one: a cell's own mean times the profile that all share.

    0 where a sample is not valid.
    """
    valid = np.ones(samples.light.shape, bool) if samples.valid is None else samples.valid
    light = np.where(valid, samples.light, 0.0).astype(np.float64)
    light /= light.sum(axis=1, keepdims=True) / valid.sum(axis=1, keepdims=True)
    profile = light.sum(axis=0) / np.maximum(valid.sum(axis=0), 1)
    bands: Floats = np.where(valid, light / np.maximum(profile, 1e-3) - 1.0, 0.0)
    return bands


def _averaged_along_rows(bands: Floats, samples: CellSamples) -> Floats:
    """(cells, k, k) with less noise: averaged along that side of the cells which is nearer to the picture's rows."""
    k = samples.lattice.k
    rows = samples.rows.reshape(-1, k, k)
    upright = np.abs(np.diff(rows, axis=1)).mean() > np.abs(np.diff(rows, axis=2)).mean()
    size = (AVERAGED, 1) if upright else (1, AVERAGED)
    return np.stack([cv2.blur(c, size, borderType=cv2.BORDER_REPLICATE) for c in bands.reshape(-1, k, k)])


def cells_tile(codeword: Bits, size: int = TILE) -> Pixels:
    """Every cell in the colour of its class, with its bit."""
    tile = blank(size)
    last = size - 1.0
    draw_cells(tile, np.array([[0, 0], [last, 0], [last, last], [0, last]]), codeword, tint=1.0)
    pitch = size / len(codeword)
    for (row, column), bit in np.ndenumerate(codeword):
        label = str(int(bit))
        width, height = text_size(label, bold=True)
        at = round((column + 0.5) * pitch - width / 2), round((row + 0.5) * pitch + height / 2)
        text(tile, label, at, colour=BACKGROUND, bold=True)
    return tile
