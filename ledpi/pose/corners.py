"""Knowledge of four corners: when each was seen, and how their errors hang together."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ledpi.core.records import Detection, Floats, Frame, Intrinsics

# What the fit does not show of a corner's error: the lens model, the panel's own build. At 2 m 0.1 mm is 0.03 px, by
# which a side may be shifted, and turned; with more, poses of a panel near by would be given several times their
# deviations.
FLOOR_PX = 0.03 * math.sqrt(2.0)
# Deviations of a robot's motion, along and about each axis, before two frames have shown it: indoor robots drive at up
# to 1 or 2 m/s, and turn on the spot by up to 2 or 3 rad/s.
SPEED_SIGMA_M_S, TURN_SIGMA_RAD_S = 1.0, 1.5
MOTION_SIGMA = np.repeat([SPEED_SIGMA_M_S, TURN_SIGMA_RAD_S], 3)
MEAN = np.tile(np.eye(2), 4) / 4.0  # (2, 8) of the corners' x and y
IMPOSSIBLE = 26.1  # χ² of eight coordinates that chance exceeds once in 1,000 times


def centre_px(corners_px: Floats) -> tuple[float, float]:
    """Returns where the middle of a square (4, 2) is seen: where its diagonals cross, which a perspective keeps."""
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = corners_px.tolist()
    across = (cx - ax) * (dy - by) - (cy - ay) * (dx - bx)
    if across == 0.0:
        return (ax + bx + cx + dx) / 4, (ay + by + cy + dy) / 4
    share = ((bx - ax) * (dy - by) - (by - ay) * (dx - bx)) / across
    return ax + share * (cx - ax), ay + share * (cy - ay)


def corners_at_row(corners_px: Floats, velocity_px_s: Floats | None, row: float | Floats, row_time_us: float) -> Floats:
    """Returns where corners (…, 4, 2) would be seen if all were exposed when `row` (…, 1, 1) was.

    A rolling shutter sees each corner at its own row's time, `y·t_row`: a camera that moves sees the square sheared.
    Without a velocity (…, 4, 2) they are taken as they are.
    """
    if velocity_px_s is None:
        return corners_px
    late_s = (corners_px[..., 1:] - row) * (row_time_us * 1e-6)
    return corners_px - velocity_px_s * late_s


def corners_at(
    frame: Frame, rows: Floats, detections: Sequence[Detection], sides_m: Sequence[float], intrinsics: Intrinsics
) -> tuple[Floats, Floats]:
    """Corners of N detections (N, 4, 2), as if all were exposed when `rows` (N,) were, and their covariances (N, 8, 8).

    These include how far the corners may have moved between the rows: by what is not known of their velocities.
    """
    corners, covariances = [], []
    for seen, row, side_m in zip(detections, rows.tolist(), sides_m, strict=True):
        velocity, covariance = _velocity(seen, side_m, intrinsics, frame.exposure_us)
        late_s = np.repeat(seen.corners_px[:, 1] - row, 2) * (frame.row_time_us * 1e-6)
        corners.append(corners_at_row(seen.corners_px, velocity, row, frame.row_time_us))
        covariances.append(seen.covariance_px2 + np.outer(late_s, late_s) * covariance)
    return np.array(corners), np.array(covariances)


def _velocity(
    seen: Detection, side_m: float, intrinsics: Intrinsics, exposure_us: float
) -> tuple[Floats | None, Floats]:
    """A detection's velocity (4, 2) px/s and its covariance (8, 8): as it was measured, or of all that a robot may do.

    Of two fits one may be off by more than it says. Then corners seem to move as before no robot's camera, and how they
    move is not known.
    """
    velocity, measured = seen.velocity_px_s, seen.velocity_covariance
    if velocity is not None and measured is None:
        return velocity, np.zeros((8, 8))
    prior = velocity_covariance(seen.corners_px, side_m, intrinsics)
    if seen.blur_px is not None:
        prior = _bounded(prior, seen.blur_px, exposure_us)
    if velocity is None or measured is None:
        return None, prior
    chi2 = float(velocity.ravel() @ np.linalg.solve(prior + measured, velocity.ravel()))
    return (velocity, measured) if chi2 < IMPOSSIBLE else (None, prior)


def _bounded(covariance: Floats, blur_px: Floats, exposure_us: float) -> Floats:
    """The covariance (8, 8) of corners' velocities before a picture that is blurred so much (2,), along x and y.

    What moves by v·T while it is exposed is blurred by v·T/√12 at least. So the corners' mean velocity is 0, with a
    deviation of all the blur that there is, be it the lens's own: a measurement, by which the covariance is updated.
    """
    along = covariance @ MEAN.T
    most_px_s = math.sqrt(12.0) * blur_px / (exposure_us * 1e-6)
    return np.asarray(covariance - along @ np.linalg.solve(MEAN @ along + np.diag(most_px_s**2), along.T))


def velocity_covariance(corners_px: Floats, side_m: float, intrinsics: Intrinsics) -> Floats:
    """(8, 8) px²/s² of how a square's corners (4, 2) move before a robot's camera, of which nothing else is known.

    A point (x, y, 1)·Z moves by L·(v, ω) in the picture, v and ω being the camera's velocities and L the interaction
    matrix (Chaumette & Hutchinson, IEEE Robotics & Automation Magazine, 2006). The longest side tells the depth.
    """
    corners, (fx, fy) = corners_px.tolist(), (intrinsics.fx, intrinsics.fy)
    near = max(math.dist(at, corners[k - 1]) for k, at in enumerate(corners)) / (fx * side_m)  # 1/Z
    rows = []
    for u, v in corners:
        x, y = (u - intrinsics.cx) / fx, (v - intrinsics.cy) / fy
        rows.append([-fx * near, 0.0, fx * x * near, fx * x * y, -fx * (1.0 + x * x), fx * y])
        rows.append([0.0, -fy * near, fy * y * near, fy * (1.0 + y * y), -fy * x * y, -fy * x])
    slopes = np.array(rows) * MOTION_SIGMA
    return np.asarray(slopes @ slopes.T)


def whiteners(covariances_px2: Floats) -> Floats:
    """(N, 8, 8) that turn errors of corners into independent ones of deviation 1: WᵀW = (covariance + floor²·I)⁻¹.

    `covariances_px2` (N, 8, 8) of x and y of each corner, as the fit has them: both ends of a side err together, and
    all sides may err outward alike, where blur and rim leave open how far the light reaches.
    """
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariances_px2 + FLOOR_PX**2 * np.eye(8))), np.float64)


def independent(sigma_px: float) -> Floats:
    """(8, 8) covariance of corners whose coordinates err by themselves, by `sigma_px`."""
    return sigma_px**2 * np.eye(8)
