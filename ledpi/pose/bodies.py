"""Bodies: where things are that carry panels. Each is a map of its own, in which the camera has a fix."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ledpi.core.geometry import matrix_from_quaternion, quaternion_from_matrix
from ledpi.core.records import BodyPose, Frame, Intrinsics, MarkerPose, PanelMap, Pose, Rejected, read_only
from ledpi.pose.fix import FixSolver, Robot
from ledpi.pose.fix_history import AMBIGUOUS, CONTRADICTION
from ledpi.pose.refine import skew

FIRST_ID = 60_000  # of a body, in the order of the configuration: no dictionary has so many words
_WHY_NOT = {
    AMBIGUOUS: Rejected(stage="body", reason="ambiguous"),
    CONTRADICTION: Rejected(stage="body", reason="panels_contradict"),
}


class BodySolver:
    """Solves the poses of the bodies before one stream's camera. `sides_m` of panels by ID."""

    def __init__(self, intrinsics: Intrinsics, bodies: Mapping[str, PanelMap], sides_m: Mapping[int, float]) -> None:
        camera = Robot(base_link_from_camera=np.eye(4))  # so that a fix is the camera's own place
        self._solvers = {name: FixSolver(intrinsics, camera, panels, sides_m) for name, panels in bodies.items()}

    def solve(self, frame: Frame, markers: Sequence[MarkerPose]) -> list[BodyPose | Rejected]:
        """Each body of which a frame shows a panel, or why it has no pose. `markers` must not be empty."""
        found: list[BodyPose | Rejected] = []
        for body_id, (name, solver) in enumerate(self._solvers.items(), FIRST_ID):
            fix = solver.solve(frame, markers)
            if isinstance(fix, Rejected):
                found += [_WHY_NOT[fix]] if fix in _WHY_NOT else []  # else nothing of it is in view
                continue
            pose = BodyPose(
                name=name,
                id=body_id,
                camera_from_body=_inverse(fix.map_from_base_link),
                mid_exposure_ns=fix.mid_exposure_ns,
                panels_used=fix.panels_used,
                panels_rejected=fix.panels_rejected,
            )
            found.append(pose)
        return found


def _inverse(a_from_b: Pose) -> Pose:
    """b_from_a. Errors δ of a_from_b's t and ω of its R, about a's axes, move −Rᵀt by −Rᵀ(δ + t × ω), and turn −Rᵀω."""
    assert a_from_b.covariance is not None
    turned, t = matrix_from_quaternion(a_from_b.quaternion_wxyz).T, a_from_b.position_m
    slopes = np.zeros((6, 6))
    slopes[:3, :3], slopes[:3, 3:], slopes[3:, 3:] = -turned, -turned @ skew(t), -turned
    return Pose(
        position_m=read_only(-turned @ t),
        quaternion_wxyz=read_only(quaternion_from_matrix(turned)),
        covariance=read_only(slopes @ a_from_b.covariance @ slopes.T),
    )
