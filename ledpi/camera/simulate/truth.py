"""The panels' true places: what a recording's truth.jsonl holds of a frame."""

from __future__ import annotations

import cv2
import numpy as np

from ledpi.camera.recording.reader import TruthMarker
from ledpi.camera.simulate.optics import PoseAt, seen_at, shows_front
from ledpi.camera.simulate.scene import Panel, Scene, SimulatedSensor
from ledpi.camera.simulate.trajectory import Trajectory
from ledpi.core.geometry import inverse, quaternion_from_matrix
from ledpi.core.records import Floats, Intrinsics, Pose, read_only

_MAX_TANGENT = 2.75  # of a corner's angle from the optical axis, 70°: lens models end there


def scene_truth(scene: Scene, seq: int) -> tuple[TruthMarker, ...]:
    """The markers that are in view in frame `seq`."""
    found = (marker_truth(p, pose_seen(scene, p.motion), scene.sensor, seq) for p in scene.panels)
    return tuple(truth for truth in found if truth is not None)


def pose_seen(scene: Scene, motion: Trajectory) -> PoseAt:
    """camera_from_body of what moves so, as a function of time."""
    camera = scene.camera_motion
    return lambda t_s: inverse(camera.scene_from_body(t_s)) @ motion.scene_from_body(t_s)


def panel_corners_m(side_m: float) -> Floats:
    """(4, 3) corners in a panel's frame, in the marker's order."""
    return side_m / 2.0 * np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]])


def marker_truth(panel: Panel, pose_at: PoseAt, sensor: SimulatedSensor, seq: int) -> TruthMarker | None:
    """A panel's truth in frame `seq`; None for decoys, panels out of view, and panels that turn their back.

    Each corner is where its own row's mid-exposure sees it; the pose is at the mid-exposure of the row of the
    panel's centre. Whether something else stands before the panel is not looked at.
    """
    corners_m = panel_corners_m(panel.spec.side_m)
    mid_frame = pose_at(sensor.mid_exposure_s(seq, (sensor.intrinsics.height - 1) / 2.0))
    if panel.marker_id is None or not _is_before_camera(corners_m, mid_frame):
        return None
    corners = np.array([seen_at(corner, pose_at, sensor, seq)[0] for corner in corners_m])
    in_view, whole = _is_in_view(corners, sensor.intrinsics)
    if not in_view:
        return None
    pose = pose_at(seen_at(np.zeros(3), pose_at, sensor, seq)[1])
    return TruthMarker(
        id=panel.marker_id,
        corners_px=read_only(corners),
        camera_from_marker=Pose(
            position_m=read_only(pose[:3, 3]), quaternion_wxyz=read_only(quaternion_from_matrix(pose[:3, :3]))
        ),
        optional=not whole,
    )


def _is_before_camera(corners_m: Floats, camera_from_marker: Floats) -> bool:
    in_camera = corners_m @ camera_from_marker[:3, :3].T + camera_from_marker[:3, 3]
    wide = np.linalg.norm(in_camera[:, :2], axis=1) > _MAX_TANGENT * in_camera[:, 2]
    return shows_front(camera_from_marker) and not bool(np.any(wide))


def _is_in_view(corners: Floats, lens: Intrinsics) -> tuple[bool, bool]:
    """Tells whether any of a quad is in the picture, and whether all of it is."""
    right, bottom = lens.width - 0.5, lens.height - 0.5
    picture = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]], np.float32)
    shared_area = cv2.intersectConvexConvex(corners.astype(np.float32), picture)[0]
    inside = (corners >= -0.5) & (corners <= (right, bottom))
    return shared_area > 0, bool(inside.all())
