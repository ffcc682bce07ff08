"""Where a lattice of bare LEDs is: by the centres of its spots' light, as `edges` tells squares by their sides."""

from __future__ import annotations

import math
from functools import cache

import cv2
import numpy as np

from ledpi.decode.corners.sides import as_points, bends
from ledpi.decode.finding.spots import rim_of
from ledpi.geometry import apply_homography, distort, undistort
from ledpi.kernels import spot_centres as kernel
from ledpi.kernels.light import can_read
from ledpi.records import Floats, Frame, Intrinsics, Quad, Rejected
from ledpi.tone import linear_light

NO_SPOTS = Rejected(stage="edges", reason="no_spots")
NOT_IN_LINE = Rejected(stage="edges", reason="spots_not_in_line")
AT_BORDER = Rejected(stage="edges", reason="at_picture_border")

ROUNDS = 2
REACH = 0.45  # of the pitch: as far around a centre as its spot's light is weighed
LEAST_SIGMA_PX = 0.05  # of a corner: lamps are not quite alike
# Of what is within reach, by the window's weight, the share that is brighter than half-way to the brightest: bare LEDs
# have 0.46 to 0.67, blurred or not; cells behind a diffuser 0.93 and more, and their sides say more than the centres.
MAX_LIT = 0.8
MAX_RMS = 0.08  # of the pitch, of the spots about their lattice: LEDs sit where the grid has them


def by_spot_centres(frame: Frame, corners: Floats, cells: int, intrinsics: Intrinsics | None = None) -> Quad | Rejected:
    """The grid whose corners are near `corners` (4, 2), by the centres of its spots' light."""
    lens, bend_px = _bent(corners, intrinsics)
    middles, rim = _middles(cells), rim_of(cells)
    pitch = min(math.dist(corners[k], corners[k - 1]) for k in range(4)) / cells
    homography = cv2.getPerspectiveTransform(rim.astype(np.float32), _flat(corners, lens).astype(np.float32))
    for _ in range(ROUNDS):
        found = _look(frame, _in_picture(middles, homography, lens), REACH * pitch)
        seen, lit = found[:, :2], float(found[:, 2].mean())
        homography = cv2.findHomography(middles, _flat(seen, lens))[0] if math.isfinite(lit) else None
        if homography is None:
            return NO_SPOTS
    if lit > MAX_LIT:
        return NO_SPOTS
    rms = float(np.sqrt(np.square(seen - _in_picture(middles, homography, lens)).mean()))
    if not rms < MAX_RMS * pitch:
        return NOT_IN_LINE
    corners = _in_picture(rim, homography, lens)
    height, width = frame.pixels.shape
    if corners.min() < 0 or corners[:, 0].max() > width - 1 or corners[:, 1].max() > height - 1:
        return AT_BORDER
    # The corners lie beyond the outermost spots: what the fit leaves of one is about the corner's error.
    sigma_px = max(rms, LEAST_SIGMA_PX)
    return Quad(corners_px=np.ascontiguousarray(corners), corner_sigma_px=sigma_px, bend_px=bend_px, told_by="spots")


def _bent(corners: Floats, intrinsics: Intrinsics | None) -> tuple[Intrinsics | None, float]:
    """The lens, where it bends the grid by more than its corners are sure of, and by how much."""
    bend_px = float(np.abs(bends(as_points(corners[None]), intrinsics).imag).max())
    return (intrinsics if bend_px > LEAST_SIGMA_PX else None), bend_px


def _flat(points: Floats, lens: Intrinsics | None) -> Floats:
    """Points (N, 2) of the picture where straight lines are straight."""
    return points if lens is None else undistort(points, lens)


def _in_picture(grid: Floats, homography: Floats, lens: Intrinsics | None) -> Floats:
    """(N, 2) where the points of a grid are seen."""
    flat = apply_homography(homography, grid)
    return flat if lens is None else distort(flat, lens)


def is_part_of(quad: Quad, grid: Quad) -> bool:
    """Whether a quad runs around the spots of a grid, or somewhere inside it."""
    side_px = math.dist(grid.corners_px[0], grid.corners_px[2]) / math.sqrt(2)
    apart = np.abs(quad.corners_px.mean(axis=0) - grid.corners_px.mean(axis=0)).max()
    return bool(apart < 0.5 * side_px)


@cache
def _middles(cells: int) -> Floats:
    """(cells², 2) of the cells, in pitches from that of the first."""
    return np.stack(np.meshgrid(np.arange(cells), np.arange(cells)), axis=-1).reshape(-1, 2).astype(np.float64)


def _look(frame: Frame, at: Floats, reach_px: float) -> Floats:
    """`_centres`, compiled where that can be had."""
    look = kernel.centres if can_read(frame) else _centres
    return look(frame, at, reach_px)


def _centres(frame: Frame, at: Floats, reach_px: float) -> Floats:
    """(N, 3) of places (N, 2) the centre of the light around that is over half of the brightest; how much is so bright.

    NaN where there is no light, or no picture. The reference of kernels/spot_centres.c.
    """
    return np.array([_centre(frame, x, y, reach_px) for x, y in at.tolist()])


def _centre(frame: Frame, x: float, y: float, reach_px: float) -> tuple[float, float, float]:
    height, width = frame.pixels.shape
    nothing = (math.nan, math.nan, math.nan)
    if not (math.isfinite(x) and math.isfinite(y)):
        return nothing
    x0, x1, y0, y1 = round(x - reach_px), round(x + reach_px) + 1, round(y - reach_px), round(y + reach_px) + 1
    if x0 < 0 or y0 < 0 or x1 > width or y1 > height or x1 - x0 < 3 or y1 - y0 < 3:
        return nothing
    light = cv2.LUT(frame.pixels[y0:y1, x0:x1], linear_light(frame.transfer, mark_saturated=False))
    across, down = np.arange(x0, x1) - x, np.arange(y0, y1) - y
    # A window that fades out: what is cut off at its border by whole pixels must not pull.
    window = np.maximum(0.0, 1.0 - (np.square(across) + np.square(down)[:, None]) / reach_px**2)
    over = np.maximum(light - np.float32(0.5) * (light.min() + light.max()), np.float32(0))
    weight = over * window
    total = float(weight.sum())
    if total <= 0:
        return nothing
    lit = float(((over > 0) * window).sum() / window.sum())
    right, low = float((weight.sum(axis=0) * across).sum()), float((weight.sum(axis=1) * down).sum())
    return x + right / total, y + low / total, lit
