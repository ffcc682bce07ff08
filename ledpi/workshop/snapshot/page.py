"""The annotated picture: the frame with overlay and explanation, above the enlarged panels."""

from __future__ import annotations

from collections import Counter
from textwrap import wrap

import cv2
import numpy as np

from ledpi.core.records import MarkerPose, Pixels
from ledpi.pipeline.diagnosis import drawing
from ledpi.pipeline.diagnosis.diagnose import Diagnosis
from ledpi.pipeline.diagnosis.why_not import Why
from ledpi.workshop.snapshot import enlarged
from ledpi.workshop.snapshot.sources import Snapshot

# Two columns; in pixels.
BORDER, GUTTER = 20, 20
COLUMN = 3 * enlarged.TILE + 2 * enlarged.GAP
LEFT, RIGHT = BORDER, BORDER + COLUMN + GUTTER
WIDTH = RIGHT + COLUMN + BORDER
PICTURES_TOP = 74  # below the heading and the pictures' titles
BLOCKS_GAP, BLOCK_PITCH = 12, enlarged.HEIGHT + 8
MAX_BLOCKS = 4
FOOTER, FOOTER_LINE, FOOTER_LETTERS = 20, 20, 130


def draw_reading(canvas: drawing.Canvas, snapshot: Snapshot, told: list[Diagnosis], scale: float) -> None:
    """Draws over the frame's picture, of which `canvas` holds a copy resized by `scale`.

    Of what was dropped, those that are `told` of have their number, from 1 on.
    """
    canvas[:] = canvas * drawing.DIMMED
    markers = [_placed(marker, snapshot) for marker in snapshot.decoded.markers]
    taken = [drawing.box_of(drawing.scaled(marker.corners_px, scale)) for marker in markers]
    for dropped in snapshot.dropped:
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
        word=snapshot.codeword(detection.id),
        side_m=snapshot.panels.spec(detection.id).side_m,
        position_m=None if pose is None else pose.position_m,
        quaternion_wxyz=None if pose is None else pose.quaternion_wxyz,
    )


def draw(snapshot: Snapshot, why: Why) -> Pixels:
    """(height, WIDTH, 3), BGR. `why`: why panels are not read in it."""
    frame = snapshot.frame
    scale = COLUMN / int(frame.pixels.shape[1])
    pictures_end = PICTURES_TOP + round(frame.pixels.shape[0] * scale)
    told = numbered(why)
    blocks = enlarged.blocks_of(snapshot, told)[:MAX_BLOCKS]
    blocks_top = pictures_end + BLOCKS_GAP
    blocks_end = blocks_top + (len(blocks) + 1) // 2 * BLOCK_PITCH
    footer = _footer(snapshot, told, why)
    height = blocks_end + FOOTER + FOOTER_LINE * len(footer)
    canvas = np.full((height, WIDTH, 3), drawing.BACKGROUND, np.uint8)
    draw_heading(canvas, snapshot)
    drawing.text(canvas, "As the camera sees it", (LEFT, 62), bold=True)
    drawing.text(canvas, "As ledpi reads it", (RIGHT, 62), bold=True)
    seen = cv2.resize(frame.pixels, (COLUMN, pictures_end - PICTURES_TOP), interpolation=cv2.INTER_AREA)
    for left in (LEFT, RIGHT):
        canvas[PICTURES_TOP:pictures_end, left : left + COLUMN] = seen[..., None]
    draw_reading(canvas[PICTURES_TOP:pictures_end, RIGHT : RIGHT + COLUMN], snapshot, told, scale)
    for index, block in enumerate(blocks):
        top, left = blocks_top + index // 2 * BLOCK_PITCH, (LEFT, RIGHT)[index % 2]
        enlarged.draw_block(canvas[top : top + enlarged.HEIGHT, left : left + COLUMN], block, snapshot)
    for index, (words, colour) in enumerate(footer):
        drawing.text(canvas, words, (LEFT, blocks_end + FOOTER + index * FOOTER_LINE), colour=colour)
    return canvas


def numbered(why: Why) -> list[Diagnosis]:
    """Numbers what is told of, from 1 on; what most likely is no panel is left out."""
    return [one for one in why.diagnoses if one.kind != "shape"]


def _footer(snapshot: Snapshot, told: list[Diagnosis], why: Why) -> list[tuple[str, drawing.Colour]]:
    """Lines in their colours: what is wrong with what is numbered, and with the picture; and what was dropped."""
    reasons = [f"{number}  {one.says}; {one.helps}" for number, one in enumerate(told, 1)]
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
