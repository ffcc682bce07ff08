"""The steps of the chosen method on one frame, side by side, as one picture."""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Pixels
from ledpi.diagnosis.drawing import BACKGROUND, DIM, text
from ledpi.tools.snapshot.page import BORDER, PICTURES_TOP, WIDTH, draw_heading
from ledpi.tools.snapshot.record import Snapshot
from ledpi.tools.snapshot.steps_likelihood import likelihood_rows
from ledpi.tools.snapshot.steps_uemura import uemura_rows
from ledpi.tools.snapshot.tiles import GAP, Row

TITLE, CAPTION = 30, 30  # heights of the lines above a row, and below its tiles


def draw_steps(snapshot: Snapshot) -> Pixels:
    """(height, WIDTH, 3), BGR: the rows of tiles of the method that decoded the frame."""
    rows = uemura_rows(snapshot) if snapshot.trace.uemura else likelihood_rows(snapshot)
    top = PICTURES_TOP - TITLE
    height = top + sum(_height(row) for row in rows) + BORDER // 2
    canvas = np.full((height, WIDTH, 3), BACKGROUND, np.uint8)
    draw_heading(canvas, snapshot)
    for row in rows:
        text(canvas, row.title, (BORDER, top + TITLE - 10), bold=True)
        left = BORDER
        for tile in row.tiles:
            tall, wide = tile.picture.shape[:2]
            canvas[top + TITLE : top + TITLE + tall, left : left + wide] = tile.picture
            text(canvas, tile.label, (left, top + TITLE + tall + 19), size=0.42, colour=DIM)
            left += wide + GAP
        top += _height(row)
    return canvas


def _height(row: Row) -> int:
    tallest: int = max(tile.picture.shape[0] for tile in row.tiles)
    return TITLE + tallest + CAPTION
