"""The whole frame, as read: cells, axes and IDs of the panels, outlines and numbers of what was dropped."""

from __future__ import annotations

from ledpi.core.records import MarkerPose
from ledpi.diagnosis.diagnose import Diagnosis
from ledpi.diagnosis.drawing import (
    DIMMED,
    DROPPED,
    FAINT,
    Canvas,
    Placed,
    box_of,
    draw_label,
    draw_markers,
    outline,
    scaled,
)
from ledpi.tools.snapshot.record import Snapshot


def draw_reading(canvas: Canvas, snapshot: Snapshot, told: list[Diagnosis], scale: float) -> None:
    """Draws over the frame's picture, of which `canvas` holds a copy resized by `scale`.

    Of what was dropped, those that are `told` of have their number, from 1 on.
    """
    canvas[:] = canvas * DIMMED
    markers = [_placed(marker, snapshot) for marker in snapshot.decoded.markers]
    taken = [box_of(scaled(marker.corners_px, scale)) for marker in markers]
    for dropped in snapshot.dropped:
        corners = scaled(dropped.corners_px, scale)
        outline(canvas, corners, FAINT, 1)
    for number, one in enumerate(told, 1):
        corners = scaled(one.corners_px, scale)
        outline(canvas, corners, DROPPED, 2)
        draw_label(canvas, corners, str(number), DROPPED, taken, bold=True)
    draw_markers(canvas, markers, snapshot.intrinsics, scale, taken[len(markers) :])


def _placed(marker: MarkerPose, snapshot: Snapshot) -> Placed:
    detection, solution = marker.detection, marker.solution
    pose = None if solution is None else solution.camera_from_marker
    return Placed(
        marker_id=detection.id,
        corners_px=detection.corners_px,
        word=snapshot.codeword(detection.id),
        side_m=snapshot.panels.spec(detection.id).side_m,
        position_m=None if pose is None else pose.position_m,
        quaternion_wxyz=None if pose is None else pose.quaternion_wxyz,
    )
