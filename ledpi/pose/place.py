"""From detections to poses: each panel where it was when its centre row was half-way through its exposure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ledpi.core.records import BodyPose, Detection, Frame, Intrinsics, MarkerPose, PlanarSolution, Rejected, RobotFix
from ledpi.core.shutter import row_mid_exposure_ns
from ledpi.pose.bodies import BodySolver
from ledpi.pose.branches import Branches
from ledpi.pose.corners import centre_px, corners_at
from ledpi.pose.fix import FixSolver, Robot
from ledpi.pose.planar import solve_squares


class Placer:
    """Places the panels of one camera's frames.

    `sides_m` by ID, where the robot's map has no other; `stream`: frames follow each other in time, else each is alone.
    Without `intrinsics` there are times, but no poses, and without a map no fixes.
    """

    def __init__(
        self,
        intrinsics: Intrinsics | None,
        sides_m: Mapping[int, float],
        *,
        stream: bool,
        robot: Robot | None = None,
    ) -> None:
        self._intrinsics = intrinsics
        self._robot = robot
        panels = robot.panels if robot is not None and robot.panels is not None else {}
        self._sides_m = {**sides_m, **{i: panel.side_m for i, panel in panels.items() if panel.side_m is not None}}
        self._stream = stream
        self._begin()

    def _begin(self) -> None:
        """Without a past."""
        robot = self._robot
        up = robot.base_link_from_camera[2, :3] if robot is not None and robot.panels_upright else None
        self._branches = Branches(up)
        self._fixes: FixSolver | None = None
        self._bodies: BodySolver | None = None
        if robot is None or self._intrinsics is None:
            return
        self._bodies = BodySolver(self._intrinsics, robot.bodies, self._sides_m)
        if robot.panels is not None:
            self._fixes = FixSolver(self._intrinsics, robot, robot.panels, self._sides_m)

    def place(self, frame: Frame, detections: list[Detection]) -> list[MarkerPose | Rejected]:
        """Gives each detection its pose, or the reason why it has none."""
        rows = [centre_px(s.corners_px)[1] for s in detections]
        if self._intrinsics is None:
            return [_marker(frame, s, row, None, None) for s, row in zip(detections, rows, strict=True)]
        if not self._stream:
            self._begin()
        if not detections:
            return []
        sides_m = [self._sides_m[s.id] for s in detections]
        corners, covariances = corners_at(frame, np.array(rows), detections, sides_m, self._intrinsics)
        solved = solve_squares(corners, covariances, sides_m, self._intrinsics)
        placed: list[MarkerPose | Rejected] = []
        for detection, row, solutions in zip(detections, rows, solved, strict=True):
            if isinstance(solutions, Rejected):
                placed.append(solutions)
                continue
            best, other = self._branches.choose(detection.id, solutions, row_mid_exposure_ns(frame, row))
            placed.append(_marker(frame, detection, row, best, other))
        return placed

    def fix(self, frame: Frame, markers: Sequence[MarkerPose]) -> RobotFix | Rejected | None:
        """Returns the robot's place in the map, or the reason why not; None without a map or a panel."""
        return self._fixes.solve(frame, markers) if self._fixes is not None and markers else None

    def bodies(self, frame: Frame, markers: Sequence[MarkerPose]) -> list[BodyPose | Rejected]:
        """Returns the poses of the bodies in view, or the reasons why not."""
        return self._bodies.solve(frame, markers) if self._bodies is not None and markers else []


def _marker(
    frame: Frame, detection: Detection, row: float, best: PlanarSolution | None, other: PlanarSolution | None
) -> MarkerPose:
    return MarkerPose(
        detection=detection, mid_exposure_ns=row_mid_exposure_ns(frame, row), solution=best, alternate=other
    )
