"""The annotated picture: the frame with overlay and explanation; below it the panels, enlarged, in three tiles each."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from textwrap import wrap
from typing import NamedTuple

import cv2
import numpy as np

from ledpi.core.codewords import Bits
from ledpi.core.geometry import first_at_top_left
from ledpi.core.records import Floats, Frame, MarkerPose, Pixels, Quad, Rejected
from ledpi.decode.evidence.cells import CellSamples, sample_cells
from ledpi.pipeline.diagnosis import drawing
from ledpi.pipeline.diagnosis.diagnose import Diagnosis
from ledpi.pipeline.diagnosis.why_not import Why
from ledpi.workshop.snapshot.sources import Snapshot

TILE, GAP = 180, 15
TITLE, CAPTION = 26, 24  # heights of the lines above and below the tiles
HEIGHT = TITLE + TILE + CAPTION
MARGIN = 0.2  # of what a view shows, around it
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
        blocks.append(
            Block(corners_px=detection.corners_px, title=title, codeword=snapshot.panels.words.codeword(detection.id))
        )
    for number, one in enumerate(told, 1):
        corners = np.roll(one.corners_px, -first_at_top_left(one.corners_px), axis=0)
        blocks.append(Block(corners_px=corners, title=f"{number}   {drawing.ascii_of(one.says)}", codeword=None))
    return blocks


def _place(marker: MarkerPose) -> str:
    if marker.solution is None:
        return "no pose"
    x, y, z = marker.solution.camera_from_marker.position_m
    return f"x {x:+.3f}  y {y:+.3f}  z {z:.3f} m"


def draw_block(canvas: drawing.Canvas, block: Block, snapshot: Snapshot) -> None:
    """Fills `canvas`, HEIGHT high."""
    drawing.text(
        canvas,
        block.title,
        (0, TITLE - 9),
        colour=drawing.DROPPED if block.codeword is None else drawing.TEXT,
        bold=True,
    )
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
        drawing.text(canvas, caption, (x, TITLE + TILE + 17), size=0.42, colour=drawing.DIM)


def blank(size: int) -> Pixels:
    """An empty tile."""
    return np.full((size, size, 3), drawing.BACKGROUND, np.uint8)


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
    pitch, wall = size / n, (1 - drawing.CELL_SHARE) / 2
    for cell, light in enumerate(grey):
        top, left = (round((c + wall) * pitch) for c in divmod(cell, n))
        bottom, right = (round((c + 1 - wall) * pitch) for c in divmod(cell, n))
        enlarged = cv2.resize(light, (right - left, bottom - top), interpolation=cv2.INTER_LINEAR)
        tile[top:bottom, left:right] = enlarged[..., None]
    return tile, share


def bands_of(samples: CellSamples) -> Floats:
    """(cells, points) light over a cell's mean times the profile that all share, less one; 0 where not valid."""
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
    drawing.draw_cells(tile, np.array([[0, 0], [last, 0], [last, last], [0, last]]), codeword, tint=1.0)
    pitch = size / len(codeword)
    for (row, column), bit in np.ndenumerate(codeword):
        label = str(int(bit))
        width, height = drawing.text_size(label, bold=True)
        at = round((column + 0.5) * pitch - width / 2), round((row + 0.5) * pitch + height / 2)
        drawing.text(tile, label, at, colour=drawing.BACKGROUND, bold=True)
    return tile


class View(NamedTuple):
    """A part of the frame, and how large it is shown."""

    left: int
    top: int
    scale: float  # pixels of the tile for each of the frame
    width: int  # of the tile
    height: int

    def crop(self, picture: Pixels) -> drawing.Canvas:
        """That part of a grey or coloured picture of the frame's size, enlarged without smoothing."""
        right, bottom = self.left + round(self.width / self.scale), self.top + round(self.height / self.scale)
        part = picture[self.top : bottom, self.left : right]
        smoothly = cv2.INTER_AREA if self.scale < 1 else cv2.INTER_NEAREST
        shown = cv2.resize(part, (self.width, self.height), interpolation=smoothly)
        return np.asarray(shown if shown.ndim == 3 else cv2.cvtColor(shown, cv2.COLOR_GRAY2BGR), np.uint8)

    def place(self, pixels: Floats) -> Floats:
        """Returns where pixels (N, 2) of the frame, whose centres have whole numbers, lie in the tile."""
        placed: Floats = (pixels + 0.5 - (self.left, self.top)) * self.scale - 0.5
        return placed

    def matrix(self) -> Floats:
        """`place` as a (3, 3) homography."""
        shift = (0.5 - np.array([self.left, self.top])) * self.scale - 0.5
        return np.array([[self.scale, 0, shift[0]], [0, self.scale, shift[1]], [0, 0, 1.0]])


def view_of(corners_px: list[Floats], shape: tuple[int, ...], width: int) -> View:
    """The part of a frame of `shape` that holds these quads and a margin of their size; all of it where there are none.

    It has the frame's proportions, and is `width` wide as a tile.
    """
    rows, columns = shape[:2]
    wide, left, top = float(columns), 0.0, 0.0
    if corners_px:
        points = np.concatenate(corners_px)
        low, high = points.min(axis=0), points.max(axis=0)
        size = (high - low) * (1 + 2 * MARGIN)
        wide = min(float(columns), max(32.0, float(size[0]), float(size[1]) * columns / rows))
        centre = (low + high) / 2
        left = min(max(0.0, float(centre[0]) - wide / 2), columns - wide)
        top = min(max(0.0, float(centre[1]) - wide * rows / columns / 2), rows - wide * rows / columns)
    whole = max(1, int(wide))
    return View(int(left), int(top), width / whole, width, round(width * rows / columns))


# Two columns; in pixels.
BORDER, GUTTER = 20, 20
COLUMN = 3 * TILE + 2 * GAP
LEFT, RIGHT = BORDER, BORDER + COLUMN + GUTTER
WIDTH = RIGHT + COLUMN + BORDER
PICTURES_TOP = 74  # below the heading and the pictures' titles
BLOCKS_GAP, BLOCK_PITCH = 12, HEIGHT + 8
MAX_BLOCKS = 4
FOOTER, FOOTER_LINE, FOOTER_LETTERS = 20, 20, 130


def draw_reading(canvas: drawing.Canvas, snapshot: Snapshot, told: list[Diagnosis], scale: float) -> None:
    """Draws over the frame's picture, of which `canvas` holds a copy resized by `scale`.

    Of what was dropped, those that are `told` of have their number, from 1 on.
    """
    canvas[:] = canvas * drawing.DIMMED
    markers = [_placed(marker, snapshot) for marker in snapshot.decoded.markers]
    taken = [drawing.box_of(drawing.scaled(marker.corners_px, scale)) for marker in markers]
    for dropped in snapshot.trace.dropped:
        corners = drawing.scaled(dropped.corners_px, scale)
        drawing.outline(canvas, corners, drawing.FAINT, 1)
    for number, one in enumerate(told, 1):
        corners = drawing.scaled(one.corners_px, scale)
        drawing.outline(canvas, corners, drawing.DROPPED, 2)
        drawing.draw_label(canvas, corners, str(number), drawing.DROPPED, taken, bold=True)
    drawing.draw_markers(canvas, markers, snapshot.intrinsics, scale, taken[len(markers) :])


def _placed(marker: MarkerPose, snapshot: Snapshot) -> drawing.Placed:
    detection, solution = marker.detection, marker.solution
    pose = None if solution is None else solution.camera_from_marker
    return drawing.Placed(
        marker_id=detection.id,
        corners_px=detection.corners_px,
        word=snapshot.panels.words.codeword(detection.id),
        side_m=snapshot.panels.spec(detection.id).side_m,
        position_m=None if pose is None else pose.position_m,
        quaternion_wxyz=None if pose is None else pose.quaternion_wxyz,
    )


def draw(snapshot: Snapshot, why: Why) -> Pixels:
    """(height, WIDTH, 3), BGR. `why`: why panels are not read in it."""
    frame = snapshot.frame
    scale = COLUMN / int(frame.pixels.shape[1])
    pictures_end = PICTURES_TOP + round(frame.pixels.shape[0] * scale)
    blocks = blocks_of(snapshot, why.told)[:MAX_BLOCKS]
    blocks_top = pictures_end + BLOCKS_GAP
    blocks_end = blocks_top + (len(blocks) + 1) // 2 * BLOCK_PITCH
    footer = _footer(snapshot, why)
    height = blocks_end + FOOTER + FOOTER_LINE * len(footer)
    canvas = np.full((height, WIDTH, 3), drawing.BACKGROUND, np.uint8)
    draw_heading(canvas, snapshot)
    drawing.text(canvas, "As the camera sees it", (LEFT, 62), bold=True)
    drawing.text(canvas, "As ledpi reads it", (RIGHT, 62), bold=True)
    seen = cv2.resize(frame.pixels, (COLUMN, pictures_end - PICTURES_TOP), interpolation=cv2.INTER_AREA)
    for left in (LEFT, RIGHT):
        canvas[PICTURES_TOP:pictures_end, left : left + COLUMN] = seen[..., None]
    draw_reading(canvas[PICTURES_TOP:pictures_end, RIGHT : RIGHT + COLUMN], snapshot, why.told, scale)
    for index, block in enumerate(blocks):
        top, left = blocks_top + index // 2 * BLOCK_PITCH, (LEFT, RIGHT)[index % 2]
        draw_block(canvas[top : top + HEIGHT, left : left + COLUMN], block, snapshot)
    for index, (words, colour) in enumerate(footer):
        drawing.text(canvas, words, (LEFT, blocks_end + FOOTER + index * FOOTER_LINE), colour=colour)
    return canvas


def _footer(snapshot: Snapshot, why: Why) -> list[tuple[str, drawing.Colour]]:
    """Lines in their colours: what is wrong with what is numbered, and with the picture; and what was dropped."""
    reasons = [f"{number}  {one.says}; {one.helps}" for number, one in enumerate(why.told, 1)]
    reasons += [f"{note.says}; {note.helps}" for note in why.notes]
    counts = Counter(rejected.key for rejected in snapshot.decoded.rejected).most_common()
    dropped = "Dropped: " + (", ".join(f"{key} {count}" for key, count in counts) or "nothing")
    lines = [(line, drawing.DROPPED) for reason in reasons for line in wrap(drawing.ascii_of(reason), FOOTER_LETTERS)]
    return lines + [(line, drawing.DIM) for line in wrap(dropped, FOOTER_LETTERS)]


def draw_heading(canvas: drawing.Canvas, snapshot: Snapshot) -> None:
    """Title, the frame's values and the classes' colours, above PICTURES_TOP."""
    frame, spec = snapshot.frame, snapshot.panels.spec()
    height, width = frame.pixels.shape
    values = f"{width} x {height}, exposure {frame.exposure_us / 1e3:.4g} ms, row time {frame.row_time_us:.2f} µs"
    drawing.text(canvas, snapshot.title, (LEFT, 30), size=0.7, bold=True)
    drawing.text(canvas, values, (WIDTH - BORDER - drawing.text_size(values)[0], 30), colour=drawing.DIM)
    at = WIDTH - BORDER
    for bit, hz, colour in ((1, spec.white_hz, drawing.WHITE_CLASS), (0, spec.black_hz, drawing.BLACK_CLASS)):
        label = f"{bit}: {hz:g} Hz"
        at -= drawing.text_size(label)[0]
        drawing.text(canvas, label, (at, 62))
        cv2.rectangle(canvas, (at - 20, 51), (at - 8, 63), colour, cv2.FILLED)
        at -= 40
