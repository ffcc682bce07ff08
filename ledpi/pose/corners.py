"""What is known of four corners: when each was seen, and how their errors hang together."""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Floats
from ledpi.kernels import pose as kernel

# What the fit does not show of a side's error: the lens model, the panel's own build. At 2 m 0.1 mm is 0.03 px;
# with more, poses of a panel near by would be given several times their deviations.
FLOOR_PX = 0.03

# The fit expects a lens's blur, 0.8 px. With motion's, a box of 4 px, it is 1.4 px: more than a deviation away
# (`decode/model/prior.py`). A square that motion blurs further may be taken for wider by a quarter of the blur on
# either side.
KNOWN_BLUR_PX, BLUR_ERROR = 4.0, 0.25
ERRORS = np.array([FLOOR_PX, KNOWN_BLUR_PX, BLUR_ERROR])  # as C takes them


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


def motion_px(velocity_px_s: Floats | None, exposure_us: float) -> Floats:
    """(…, 4, 2) how far the corners move during an exposure; zero where that is not known."""
    return np.zeros((4, 2)) if velocity_px_s is None else velocity_px_s * (exposure_us * 1e-6)


def whiteners(corners_px: Floats, sigma_px: Floats, size_sigma_px: Floats, motions_px: Floats | None = None) -> Floats:
    """(N, 8, 8) that turn errors of corners (N, 4, 2) into independent ones of deviation 1: WᵀW = covariance⁻¹.

    A corner is where two sides cross, so its error is theirs. Of a straight line through n places of spread s, the
    middle has the deviation s/√n and the ends, about the middle, √3 times that: with σ = 2s/√n for a corner
    coordinate these are σ/2 and √3·σ/2. Both ends of a side err together: taking corners for independent would
    overstate the error of the distance, and understate that of the tilt. To each the floor is added; and to the shift,
    where the square moves by `motions_px` (N, 4, 2) during the exposure, what a blur beyond the known one may hide.

    Of the deviation of coordinates `sigma_px` (N,) all sides share `size_sigma_px` (N,), and σ is the rest: the square
    may be larger or smaller about its centre, and its sides then move by that, in the mean. Of the covariance of their
    shifts that is a part of rank one, q·qᵀ in the deviations of each, and (I + q·qᵀ)^(−½) makes what they share 1.
    """
    motions_px = np.zeros_like(corners_px) if motions_px is None else motions_px
    return kernel.whiteners(ERRORS, corners_px, sigma_px, size_sigma_px, motions_px)
