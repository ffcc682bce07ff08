"""Results of decoding, as the JSON object that `ledpi decode` prints."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from typing import Any

import numpy as np

from ledpi.core.records import BodyPose, Decoded, Floats, MarkerPose, Pose, RobotFix
from ledpi.state.estimator import State


def decoded_as_json(decoded: Decoded, recording: str) -> dict[str, Any]:
    """One frame, in the form and the order of the documentation; numbers rounded below what they can mean."""
    values = {
        "recording": recording,
        "seq": decoded.seq,
        "sensor_timestamp_ns": decoded.row0_readout_ns,
        "decode_ms": round(sum(decoded.stage_ms.values()), 3),
        "markers": [_marker(marker) for marker in decoded.markers],
        "robot": None if decoded.robot is None else _by_panels(decoded.robot.map_from_base_link, decoded.robot),
        "rejected": dict(sorted(Counter(rejected.key for rejected in decoded.rejected).items())),
    }
    bodies = [{"id": b.id, "name": b.name, **_by_panels(b.camera_from_body, b)} for b in decoded.bodies]
    return values | ({"bodies": bodies} if bodies else {})


def state_as_json(state: State | None, t_ns: int, offset_ns: int = 0) -> dict[str, Any]:
    """The robot's state at a time; its numbers are null where there is none. `offset_ns` is taken off all times."""
    if state is None:
        keys = (
            "position_m",
            "yaw_rad",
            "covariance",
            "velocity",
            "panel_ns",
            "way_m",
            "mount_deg",
            "mount_deviations_deg",
        )
        nothing = {"panels": 0, "contested": False, "moved": [], "relocalisations": 0, "events": []}
        return {"t_ns": t_ns - offset_ns, "mode": "none", **dict.fromkeys(keys), **nothing}
    turned_deg, deviations_deg = np.degrees(state.mount_rad).round(3).tolist()
    return {
        "t_ns": state.t_ns - offset_ns,
        "mode": "odometry" if state.by_odometry else "panels",
        "position_m": [round(float(v), 6) for v in state.pose[:2]],
        "yaw_rad": round(float(state.pose[2]), 7),
        "covariance": _numbers(state.covariance),
        "velocity": [round(state.speed_m_s, 4), round(state.turn_rad_s, 4)],
        "panel_ns": state.panel_ns - offset_ns,
        "way_m": round(state.way_m, 4),
        "panels": state.panels,
        "contested": state.contested,
        "moved": list(state.moved),
        "relocalisations": state.relocalisations,
        "mount_deg": turned_deg,
        "mount_deviations_deg": deviations_deg,
        "events": [asdict(event) | {"t_ns": event.t_ns - offset_ns} for event in state.events],
    }


def _marker(marker: MarkerPose) -> dict[str, Any]:
    detection, solution = marker.detection, marker.solution
    pose = solution.camera_from_marker if solution is not None else None
    return {
        "id": detection.id,
        "corners_px": [[round(float(v), 3) for v in corner] for corner in detection.corners_px],
        "margin": round(detection.margin, 2),
        "frames_used": detection.frames_used,
        **(_place(pose) if pose is not None else dict.fromkeys(("position_m", "quaternion_wxyz"))),
        "covariance": None if pose is None else _numbers(pose.covariance),
        "reprojection_px": None if solution is None else round(solution.reprojection_px, 4),
        "alternate": None
        if marker.alternate is None
        else {
            **_place(marker.alternate.camera_from_marker),
            "reprojection_px": round(marker.alternate.reprojection_px, 4),
        },
    }


def _place(pose: Pose) -> dict[str, list[float]]:
    return {
        "position_m": [round(float(v), 6) for v in pose.position_m],
        "quaternion_wxyz": [round(float(v), 7) for v in pose.quaternion_wxyz],
    }


def _numbers(covariance: Floats | None) -> list[float] | None:
    return None if covariance is None else [float(f"{v:.6g}") for v in covariance.ravel()]


def _by_panels(pose: Pose, by: RobotFix | BodyPose) -> dict[str, Any]:
    return {
        **_place(pose),
        "covariance": _numbers(pose.covariance),
        "panels_used": list(by.panels_used),
        "panels_rejected": list(by.panels_rejected),
    }
