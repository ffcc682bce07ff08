"""What is known of four corners: when each was seen, and how their errors hang together."""

from __future__ import annotations

import math

import numpy as np

from ledpi.core.records import Floats

# What the fit does not show of a corner's error: the lens model, the panel's own build. At 2 m 0.1 mm is 0.03 px, by
# which a side may be shifted, and turned; with more, poses of a panel near by would be given several times their
# deviations.
FLOOR_PX = 0.03 * math.sqrt(2.0)


def centre_px(corners_px: Floats) -> tuple[float, float]:
    """Where the middle of a square (4, 2) is seen: where its diagonals cross, which a perspective keeps."""
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = corners_px.tolist()
    across = (cx - ax) * (dy - by) - (cy - ay) * (dx - bx)
    if across == 0.0:
        return (ax + bx + cx + dx) / 4, (ay + by + cy + dy) / 4
    share = ((bx - ax) * (dy - by) - (by - ay) * (dx - bx)) / across
    return ax + share * (cx - ax), ay + share * (cy - ay)


def corners_at_row(corners_px: Floats, velocity_px_s: Floats | None, row: float | Floats, row_time_us: float) -> Floats:
    """Where corners (…, 4, 2) would be seen if all were exposed when `row` (…, 1, 1) was.

    A rolling shutter sees each corner at its own row's time, `y·t_row`: a camera that moves sees the square sheared.
    Without a velocity (…, 4, 2) they are taken as they are.
    """
    if velocity_px_s is None:
        return corners_px
    late_s = (corners_px[..., 1:] - row) * (row_time_us * 1e-6)
    return corners_px - velocity_px_s * late_s


def whiteners(covariances_px2: Floats) -> Floats:
    """(N, 8, 8) that turn errors of corners into independent ones of deviation 1: WᵀW = (covariance + floor²·I)⁻¹.

    `covariances_px2` (N, 8, 8) of x and y of each corner, as the fit has them: both ends of a side err together, and
    all sides may err outward alike, where blur and rim leave open how far the light reaches.
    """
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariances_px2 + FLOOR_PX**2 * np.eye(8))), np.float64)


def independent(sigma_px: float) -> Floats:
    """(8, 8) covariance of corners whose coordinates err by themselves, by `sigma_px`."""
    return sigma_px**2 * np.eye(8)
