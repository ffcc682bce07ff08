"""The robot's place: one pose from all corners of all panels that the map knows.

Everything is brought to one moment, and weighed by how well it is known: corners by their fit, panels by what the map
says of its own deviations. The panels' own poses are only where the joint solution starts from.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ledpi.core.geometry import inverse, matrix_from_quaternion, quad_side, quaternion_from_matrix, transform
from ledpi.core.lens import projected
from ledpi.core.records import (
    Floats,
    Frame,
    Intrinsics,
    MarkerPose,
    PanelMap,
    PlanarSolution,
    Pose,
    Rejected,
    RobotFix,
    read_only,
)
from ledpi.core.shutter import row_mid_exposure_ns
from ledpi.pose.branches import EXCLUDED_BY
from ledpi.pose.corners import centre_px, corners_at, whiteners
from ledpi.pose.fix_history import Candidate, FixHistory, distance2
from ledpi.pose.planar import square_corners
from ledpi.pose.refine import Fits, fit_body, skew

NOT_IN_MAP = Rejected(stage="fix", reason="not_in_map")

# Panels agree where their joint χ² is one that chance exceeds once in 1,000 times: 3.09 deviations of a normal.
AGREE_Z = 3.09
MAX_STARTS = 6  # of the joint solution: both poses of the three largest panels
ONE_POSE = 1.0  # solutions that are no further apart than one deviation are one


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Robot:
    """The camera's seat on the robot, the map that the robot drives in, and what else carries panels."""

    base_link_from_camera: Floats  # (4, 4)
    panels: PanelMap | None = None
    panels_upright: bool = False
    bodies: Mapping[str, PanelMap] = field(default_factory=dict)  # by name, each in its own frame


@dataclass(frozen=True, slots=True)
class _Observations:
    """The N panels of the map that a frame shows, at one moment."""

    ids: tuple[int, ...]
    points: Floats  # (N, 4, 3) of their corners in the map, about `middle`
    middle: Floats  # (3,) in the map: small numbers keep the equations well conditioned
    corners_px: Floats  # (N, 4, 2)
    whiteners: Floats  # (N, 8, 8)
    starts: tuple[tuple[Floats, ...], ...]  # of each panel, camera_from_middle (4, 4): one or two, the likelier first

    def exclude(self, index: int) -> _Observations:
        keep = [i for i in range(len(self.ids)) if i != index]
        starts = tuple(self.starts[i] for i in keep)
        ids = tuple(self.ids[i] for i in keep)
        return _Observations(ids, self.points[keep], self.middle, self.corners_px[keep], self.whiteners[keep], starts)


class FixSolver:
    """Solves one stream's fixes. `sides_m` by ID."""

    def __init__(self, intrinsics: Intrinsics, robot: Robot, panels: PanelMap, sides_m: Mapping[int, float]) -> None:
        self._intrinsics = intrinsics
        self._camera_from_base = inverse(robot.base_link_from_camera)
        self._panels = panels
        self._marker_from_map = {i: inverse(panel.map_from_marker) for i, panel in panels.items()}
        self._sides_m = sides_m
        self._squares = {i: square_corners(sides_m[i]) for i in panels if i in sides_m}
        self.history = FixHistory()

    def solve(self, frame: Frame, markers: Sequence[MarkerPose]) -> RobotFix | Rejected:
        """map_from_base_link from the panels of a frame, or why there is none. `markers` must not be empty.

        Where several poses fit, the last fix decides, or there is none; where panels contradict each other, others do.
        """
        known = [m for m in markers if m.detection.id in self._panels and m.solution is not None]
        if not known:
            return NOT_IN_MAP
        known.sort(key=lambda m: -quad_side(m.detection.corners_px.tolist()))
        row = float(np.mean([centre_px(m.detection.corners_px)[1] for m in known]))
        now_ns = row_mid_exposure_ns(frame, row)
        candidates = self._candidates(self._observe(known, row, frame))
        chosen = self.history.choose(candidates, now_ns)
        if isinstance(chosen, Rejected):
            return chosen
        pose = Pose(
            position_m=read_only(chosen.map_from_base[:3, 3]),
            quaternion_wxyz=read_only(quaternion_from_matrix(chosen.map_from_base[:3, :3])),
            covariance=read_only(chosen.covariance),
        )
        return RobotFix(
            map_from_base_link=pose,
            mid_exposure_ns=now_ns,
            panels_used=tuple(sorted(chosen.used)),
            panels_rejected=tuple(sorted(chosen.rejected)),
        )

    def _observe(self, known: list[MarkerPose], row: float, frame: Frame) -> _Observations:
        ids = tuple(m.detection.id for m in known)
        places = np.array([self._panels[i].map_from_marker for i in ids])
        squares = np.array([self._squares[i] for i in ids])
        middle = places[:, :3, 3].mean(axis=0)
        places[:, :3, 3] -= middle
        map_from_middle = transform(np.eye(3), middle)
        detections = [m.detection for m in known]
        sides_m = [self._sides_m[i] for i in ids]
        corners, covariances = corners_at(frame, np.full(len(ids), row), detections, sides_m, self._intrinsics)
        whiten = whiteners(covariances)
        starts, preferred = [], []
        for marker in known:
            marker_from_middle = self._marker_from_map[marker.detection.id] @ map_from_middle
            poses = [_matrix(s) for s in (marker.solution, marker.alternate) if s is not None]
            preferred.append(poses[0])
            starts.append(tuple(pose @ marker_from_middle for pose in poses))
        return _Observations(
            ids=ids,
            points=squares @ places[:, :3, :3].transpose(0, 2, 1) + places[:, None, :3, 3],
            middle=middle,
            corners_px=corners,
            whiteners=self._add_map_errors(whiten, ids, squares, np.array(preferred)),
            starts=tuple(starts),
        )

    def _add_map_errors(self, whiten: Floats, ids: tuple[int, ...], squares: Floats, poses: Floats) -> Floats:
        """Whiteners (N, 8, 8) that also count with the panels not being just where the map has them.

        A panel that is off by (δ, ω) moves its corners by J·(δ, ω), so their covariance grows by J·Σ·Jᵀ. Equal
        deviations along all axes are the same in every frame of reference.
        """
        panels = [self._panels[i] for i in ids]
        variances = np.array([[p.position_sigma_m**2] * 3 + [p.angle_sigma_rad**2] * 3 for p in panels])
        if not variances.any():
            return whiten
        arms = squares @ poses[:, :3, :3].transpose(0, 2, 1)
        _, by_point = projected(arms + poses[:, None, :3, 3], self._intrinsics)
        slopes = np.concatenate([by_point, -by_point @ skew(arms)], axis=-1).reshape(len(ids), 8, 6)
        from_corners = np.linalg.inv(whiten)
        covariance = from_corners @ from_corners.transpose(0, 2, 1)
        covariance += (slopes * variances[:, None, :]) @ slopes.transpose(0, 2, 1)
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)), np.float64)

    def _candidates(self, seen: _Observations, excluded: tuple[int, ...] = ()) -> list[Candidate]:
        """The poses that the panels allow; more than one where they do not decide."""
        fits = self._fit(seen)
        if len(seen.ids) == 1 or _agrees(fits, len(seen.ids)):
            return self._distinct(fits, seen, excluded)
        fewer = [seen.exclude(i) for i in range(len(seen.ids))]
        tried = [self._fit(rest) for rest in fewer]
        chi2 = [float(t.chi2.min()) for t in tried]
        best = int(np.argmin(chi2))
        if len(seen.ids) > 2 and not _agrees(tried[best], len(seen.ids) - 1):
            return self._candidates(fewer[best], (*excluded, seen.ids[best]))
        # The one without which the others agree; of two each, as each agrees with itself.
        as_good = [i for i, value in enumerate(chi2) if value <= chi2[best] + EXCLUDED_BY]
        return [c for i in as_good for c in self._distinct(tried[i], fewer[i], (*excluded, seen.ids[i]))]

    def _fit(self, seen: _Observations) -> Fits:
        """camera_from_middle, from each of the starts."""
        starts = np.array([start for both in seen.starts for start in both][:MAX_STARTS])
        corners = seen.points.reshape(-1, 3), seen.corners_px.reshape(-1, 2), seen.whiteners
        fits = fit_body(starts[:, :3, :3], starts[:, :3, 3], *corners, self._intrinsics, at_most=2)
        return fits if len(seen.ids) > 1 else _kept_apart(fits, starts)

    def _distinct(self, fits: Fits, seen: _Observations, excluded: tuple[int, ...]) -> list[Candidate]:
        """The different poses among fits that are not excluded by the best; of one panel its own two, as preferred."""
        found: list[Candidate] = []
        order = range(len(fits.chi2)) if len(seen.ids) == 1 else np.argsort(fits.chi2).tolist()
        for k in order:
            if len(seen.ids) > 1 and fits.chi2[k] > fits.chi2.min() + EXCLUDED_BY:
                break
            candidate = self._candidate(fits, k, seen, excluded)
            if all(distance2(candidate, other, candidate.covariance) > ONE_POSE for other in found):
                found.append(candidate)
        return found

    def _candidate(self, fits: Fits, k: int, seen: _Observations, excluded: tuple[int, ...]) -> Candidate:
        """The robot's pose of a camera's, with its covariance.

        With camera_from_map R, t and the robot's origin c in the camera, b = Rᵀ(c − t): errors δ of t and ω of R, about
        the camera's axes, move b by Rᵀ((c − t) × ω − δ), and turn the robot by −Rᵀω.
        """
        turned, shift = fits.rotations[k].T, fits.positions[k]
        to_base = self._camera_from_base[:3, 3] - shift
        slopes = np.zeros((6, 6))
        slopes[:3, :3], slopes[:3, 3:], slopes[3:, 3:] = -turned, turned @ skew(to_base), -turned
        return Candidate(
            map_from_base=transform(turned @ self._camera_from_base[:3, :3], seen.middle + turned @ to_base),
            covariance=slopes @ fits.covariances[k] @ slopes.T,
            used=seen.ids,
            rejected=excluded,
        )


def _matrix(solution: PlanarSolution) -> Floats:
    pose = solution.camera_from_marker
    return transform(matrix_from_quaternion(pose.quaternion_wxyz), pose.position_m)


def _kept_apart(fits: Fits, starts: Floats) -> Fits:
    """One panel's fits, of which one that ran into the minimum of the other start stays where it began.

    A panel's mirror pose need not be a minimum to be possible. Were it lost here, one pose alone would be taken for
    certain, though the panel leaves two open.
    """
    if len(fits.chi2) < 2:
        return fits
    # The trace of AᵀB is the larger the less A is turned from B.
    likeness = np.einsum("kij,sij->ks", fits.rotations, starts[:, :3, :3])
    strayed = likeness.argmax(axis=1) != np.arange(len(starts))
    rotations = np.where(strayed[:, None, None], starts[:, :3, :3], fits.rotations)
    return replace(fits, rotations=rotations, positions=np.where(strayed[:, None], starts[:, :3, 3], fits.positions))


def _agrees(fits: Fits, panels: int) -> bool:
    """Tells whether the best χ² is one that chance gives: Wilson and Hilferty's cube is normal."""
    freedom = 8 * panels - 6
    spread = 2 / (9 * freedom)
    return bool(fits.chi2.min() < freedom * (1 - spread + AGREE_Z * math.sqrt(spread)) ** 3)
