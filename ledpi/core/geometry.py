"""Rotations, quads and homographies. Pure arithmetic."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ledpi.core.records import Floats


def quaternion_from_matrix(matrix: Floats) -> Floats:
    """Unit quaternion (w, x, y, z), w ≥ 0, of a (3, 3) rotation matrix. Shepperd's method: the largest part first."""
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    squares = (1 + a + e + i, 1 + a - e - i, 1 - a + e - i, 1 - a - e + i)
    largest = squares.index(max(squares))
    s = 2.0 * math.sqrt(squares[largest])
    wx, wy, wz = (h - f) / s, (c - g) / s, (d - b) / s
    xy, xz, yz = (b + d) / s, (c + g) / s, (f + h) / s
    quarter = s / 4.0
    rows = ((quarter, wx, wy, wz), (wx, quarter, xy, xz), (wy, xy, quarter, yz), (wz, xz, yz, quarter))
    q = np.array(rows[largest])
    q /= math.copysign(math.sqrt(q @ q), q[0])
    return q


def matrix_from_quaternion(quaternion_wxyz: Floats) -> Floats:
    """(3, 3) rotation matrix of a quaternion (w, x, y, z) of any length but zero."""
    w, x, y, z = quaternion_wxyz.tolist()
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if not norm > 0:
        raise ValueError("a quaternion of length zero is no rotation")
    w, x, y, z = w / norm, x / norm, y / norm, z / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotation_angle_deg(a: Floats, b: Floats) -> float:
    """Angle of the rotation between two quaternions (w, x, y, z) of any length but zero, in degrees, 0 to 180.

    By its tangent: the cosine of a small angle is 1, and a quaternion that was rounded to six digits made 0.1° of that.
    """
    (aw, ax, ay, az), (bw, bx, by, bz) = a.tolist(), b.tolist()
    w = aw * bw + ax * bx + ay * by + az * bz  # of a⁻¹·b, times both lengths
    x = aw * bx - ax * bw - ay * bz + az * by
    y = aw * by - ay * bw - az * bx + ax * bz
    z = aw * bz - az * bw - ax * by + ay * bx
    return math.degrees(2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), abs(w)))


def rotation_vector(matrix: Floats) -> Floats:
    """(3,) axis times angle in radians of a (3, 3) rotation, 0 to π."""
    w, *axis = quaternion_from_matrix(matrix).tolist()
    length = math.hypot(*axis)
    scale = 2.0 * math.atan2(length, w) / length if length > 1e-12 else 2.0
    return scale * np.array(axis)


def quad_area(corners: Sequence[Sequence[float]]) -> float:
    """Computes the area of four corners (x, y), number by number; positive where they run clockwise in the picture."""
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = corners
    return 0.5 * ((x2 - x0) * (y3 - y1) - (x3 - x1) * (y2 - y0))


def quad_side(corners: Sequence[Sequence[float]]) -> float:
    """The side of a square of the same area."""
    return math.sqrt(abs(quad_area(corners)))


def quad_middle(corners: Sequence[Sequence[float]]) -> tuple[float, float]:
    """Mean of the corners."""
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = corners
    return 0.25 * (x0 + x1 + x2 + x3), 0.25 * (y0 + y1 + y2 + y3)


def corners_apart(corners: Sequence[Sequence[float]], others: Sequence[Sequence[float]]) -> float:
    """Returns how far a corner of one square is from the nearest of the other, at most; in whichever order both are."""
    return max(min(math.dist(at, there) for there in others) for at in corners)


def unit_square_homography(corners: Floats) -> Floats:
    """(3, 3) homography that takes (0,0) (1,0) (1,1) (0,1) to the four `corners` (4, 2).

    Heckbert's closed form (Fundamentals of Texture Mapping, 1989). Never raises: where both sides at the third corner
    lie on one line it gives NaN, which callers refuse.
    """
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = corners.tolist()
    dx1, dx2, dx3 = x1 - x2, x3 - x2, x0 - x1 + x2 - x3
    dy1, dy2, dy3 = y1 - y2, y3 - y2, y0 - y1 + y2 - y3
    det = dx1 * dy2 - dx2 * dy1
    if det == 0.0:
        return np.full((3, 3), np.nan)
    g = (dx3 * dy2 - dx2 * dy3) / det
    h = (dx1 * dy3 - dx3 * dy1) / det
    return np.array([[x1 - x0 + g * x1, x3 - x0 + h * x3, x0], [y1 - y0 + g * y1, y3 - y0 + h * y3, y0], [g, h, 1.0]])


def apply_homography(homography: Floats, points: Floats) -> Floats:
    """Points (N, 2) through a (3, 3) homography: (N, 2)."""
    x, y, w = homography @ np.column_stack([points, np.ones(len(points))]).T
    return np.stack([x / w, y / w], axis=1)


def project_to_quad(corners: Floats, places: Floats) -> Floats:
    """Returns where places (N, 2) of the unit square are seen whose corners are seen at `corners` (4, 2): (N, 2)."""
    return apply_homography(unit_square_homography(corners), places)


def box(left: float, top: float, right: float, bottom: float) -> Floats:
    """(4, 2) corners of a box along the axes, clockwise in the picture from the top left."""
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def first_at_top_left(corners: Floats) -> int:
    """Which of the corners (4, 2) of a quad is at the picture's top left."""
    return int(np.argmin(corners.sum(axis=1)))


def square_box(low: float, high: float) -> Floats:
    """(4, 2) the same of a square from `low` to `high` on either axis."""
    return box(low, low, high, high)


def transform(rotation: Floats, position_m: Floats) -> Floats:
    """The (4, 4) matrix of a (3, 3) rotation followed by a (3,) shift."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = position_m
    return matrix


def inverse(a_from_b: Floats) -> Floats:
    """b_from_a of a rigid (4, 4) a_from_b."""
    turned = a_from_b[:3, :3].T
    return transform(turned, -turned @ a_from_b[:3, 3])


def matrix_from_rpy_deg(roll: float, pitch: float, yaw: float) -> Floats:
    """(3, 3) rotation: roll about x, then pitch about y, then yaw about z, the axes fixed (REP-103)."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(math.radians(a)), math.cos(math.radians(a))) for a in (roll, pitch, yaw))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rpy_deg_from_matrix(rotation: Floats) -> tuple[float, float, float]:
    """Roll, pitch, yaw of a (3, 3) rotation; where pitch is ±90° only their sum is defined, and roll is 0."""
    r = rotation.tolist()
    level = math.hypot(r[0][0], r[1][0])
    pitch = math.atan2(-r[2][0], level)
    if level < 1e-9:
        return 0.0, math.degrees(pitch), math.degrees(math.atan2(-r[0][1], r[1][1]))
    return math.degrees(math.atan2(r[2][1], r[2][2])), math.degrees(pitch), math.degrees(math.atan2(r[1][0], r[0][0]))


# A camera_link has x ahead, y left, z up (REP-103); the optical frame `camera` x right, y down, z ahead.
CAMERA_LINK_FROM_CAMERA = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
# A panel that faces along x and hangs upright: its z (out of it) is x, its x (right, as it is looked at) y, its y z.
# So a tag faces in WPILib's field layouts too.
FACING_FROM_MARKER = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
