"""Views of a board → a fisheye's intrinsics: bundle adjustment of an equidistant lens and of every view's pose. Pure.

OpenCV's own (`cv2.fisheye.calibrate`) gives up on views near the rim, and tells no deviations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ledpi.core.lens import projected, undistort
from ledpi.core.records import COEFFICIENTS, Floats, Intrinsics

# Across the picture: one of these is near enough to begin with.
FIELDS_DEG = (60.0, 90.0, 120.0, 150.0, 180.0)
ROUNDS, CONVERGED = 50, 1e-9  # of Levenberg and Marquardt; of the squares, that a step still gains
LENS_VALUES = 4 + len(COEFFICIENTS["equidistant"])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FisheyeFit:
    """The lens and the views' poses that explain the corners best."""

    lens: Intrinsics
    rotations: tuple[Floats, ...]  # (3, 3) camera_from_board of each view
    residuals_px: tuple[Floats, ...]  # (N, 2) of each view, from where the lens has them to where they were found
    deviations: Floats  # (8,) of fx fy cx cy (px) k1 k2 k3 k4


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    lens: Intrinsics
    rotations: list[Floats]
    shifts: list[Floats]


def fit_fisheye(boards: Sequence[Floats], seen_px: Sequence[Floats], size: tuple[int, int]) -> FisheyeFit | None:
    """The best equidistant lens, from corners (N, 3) of the board and where each view (N, 2) shows them.

    Least squares over f, c, k1 to k4 and six values a view, by Levenberg and Marquardt's method; the covariance is
    σ²(JᵀJ)⁻¹. None where no start leads to a lens.
    """
    starts = [_begun(boards, seen_px, _first_lens(size, degrees)) for degrees in FIELDS_DEG]
    costs = [math.inf if start is None else _cost(start, boards, seen_px) for start in starts]
    state = starts[int(np.argmin(costs))]
    if state is None or not math.isfinite(min(costs)):
        return None
    state, information = _refined(state, boards, seen_px)
    left = _residuals(state, boards, seen_px)
    freedom = max(1, 2 * sum(map(len, left)) - len(information))
    variance = float(sum((r * r).sum() for r in left)) / freedom
    try:
        deviations = np.sqrt(variance * np.diag(np.linalg.inv(information))[:LENS_VALUES])
    except np.linalg.LinAlgError:
        return None
    return FisheyeFit(
        lens=state.lens, rotations=tuple(state.rotations), residuals_px=tuple(left), deviations=np.asarray(deviations)
    )


def _first_lens(size: tuple[int, int], degrees: float) -> Intrinsics:
    width, height = size
    focal, bent = width / math.radians(degrees), (0.0,) * len(COEFFICIENTS["equidistant"])
    centre = {"cx": (width - 1) / 2, "cy": (height - 1) / 2}
    return Intrinsics(
        width=width, height=height, fx=focal, fy=focal, **centre, distortion=bent, distortion_model="equidistant"
    )


def _begun(boards: Sequence[Floats], seen_px: Sequence[Floats], lens: Intrinsics) -> _State | None:
    """Each view's pose by its rays alone; None where the lens shows a corner nowhere."""
    rotations, shifts = [], []
    for points, seen in zip(boards, seen_px, strict=True):
        rays = undistort(seen, lens)
        if not np.isfinite(rays).all():
            return None
        try:
            solved, turn, shift = cv2.solvePnP(points, rays, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
        except cv2.error:
            return None
        if not solved or not np.isfinite(shift).all():
            return None
        rotations.append(np.asarray(cv2.Rodrigues(turn)[0], np.float64))
        shifts.append(np.asarray(shift, np.float64).ravel())
    return _State(lens, rotations, shifts)


def _residuals(state: _State, boards: Sequence[Floats], seen_px: Sequence[Floats]) -> list[Floats]:
    views = zip(state.rotations, state.shifts, boards, seen_px, strict=True)
    return [seen - projected(points @ turn.T + shift, state.lens)[0] for turn, shift, points, seen in views]


def _cost(state: _State, boards: Sequence[Floats], seen_px: Sequence[Floats]) -> float:
    squares = float(sum((r * r).sum() for r in _residuals(state, boards, seen_px)))
    return squares if math.isfinite(squares) else math.inf


def _refined(state: _State, boards: Sequence[Floats], seen_px: Sequence[Floats]) -> tuple[_State, Floats]:
    """The nearest best state, and the information (JᵀJ) there."""
    cost, damping = _cost(state, boards, seen_px), 1e-3
    information, pull = _normal_equations(state, boards, seen_px)
    for _ in range(ROUNDS):
        scale = np.diag(np.maximum(np.diag(information), 1e-12))
        try:
            step = np.asarray(np.linalg.solve(information + damping * scale, pull), np.float64)
        except np.linalg.LinAlgError:
            break
        trial = _stepped(state, step)
        trial_cost = math.inf if trial is None else _cost(trial, boards, seen_px)
        if trial is None or not trial_cost < cost:
            damping *= 10.0
            if damping > 1e9:
                break
            continue
        gained, state, cost, damping = cost - trial_cost, trial, trial_cost, max(damping / 10.0, 1e-12)
        information, pull = _normal_equations(state, boards, seen_px)
        if gained < CONVERGED * (1.0 + cost):
            break
    return state, information


def _stepped(state: _State, step: Floats) -> _State | None:
    lens = state.lens
    values = np.array([lens.fx, lens.fy, lens.cx, lens.cy, *lens.distortion]) + step[:LENS_VALUES]
    fx, fy, cx, cy, *bent = values.tolist()
    try:
        lens = replace(lens, fx=fx, fy=fy, cx=cx, cy=cy, distortion=tuple(bent))
    except ValueError:
        return None
    by_view = step[LENS_VALUES:].reshape(-1, 6)
    shifts = [shift + change[:3] for shift, change in zip(state.shifts, by_view, strict=True)]
    rotations = [
        np.asarray(cv2.Rodrigues(change[3:])[0], np.float64) @ turn
        for turn, change in zip(state.rotations, by_view, strict=True)
    ]
    return _State(lens, rotations, shifts)


def _normal_equations(state: _State, boards: Sequence[Floats], seen_px: Sequence[Floats]) -> tuple[Floats, Floats]:
    """JᵀJ and Jᵀr: the lens's values first, then each view's shift and turn."""
    size = LENS_VALUES + 6 * len(boards)
    information, pull = np.zeros((size, size)), np.zeros(size)
    for k, (points, seen) in enumerate(zip(boards, seen_px, strict=True)):
        arms = points @ state.rotations[k].T
        pixels, by_point = projected(arms + state.shifts[k], state.lens)
        # A turn t moves an arm a by t × a: its slope is (a × slope by the point), row by row.
        by_turn = np.cross(arms[:, None, :], by_point)
        by_view = np.concatenate([by_point, by_turn], axis=2).reshape(-1, 6)
        by_lens = _slopes_by_lens(state.lens, arms + state.shifts[k], pixels).reshape(-1, LENS_VALUES)
        left = (seen - pixels).ravel()
        own = slice(LENS_VALUES + 6 * k, LENS_VALUES + 6 * (k + 1))
        information[:LENS_VALUES, :LENS_VALUES] += by_lens.T @ by_lens
        information[:LENS_VALUES, own] = by_lens.T @ by_view
        information[own, :LENS_VALUES] = by_view.T @ by_lens
        information[own, own] = by_view.T @ by_view
        pull[:LENS_VALUES] += by_lens.T @ left
        pull[own] = by_view.T @ left
    return information, pull


def _slopes_by_lens(lens: Intrinsics, points: Floats, pixels: Floats) -> Floats:
    """(N, 2, 8) derivative of pixels by fx fy cx cy k1 to k4."""
    slopes = np.zeros((len(points), 2, LENS_VALUES))
    slopes[:, 0, 0], slopes[:, 1, 1] = (pixels[:, 0] - lens.cx) / lens.fx, (pixels[:, 1] - lens.cy) / lens.fy
    slopes[:, 0, 2] = slopes[:, 1, 3] = 1.0
    # They enter with powers of the angle from the axis: θ³ θ⁵ θ⁷ θ⁹, along the radius.
    aside = np.linalg.norm(points[:, :2], axis=1)
    angle = np.arctan2(aside, points[:, 2])
    along = points[:, :2] / np.maximum(aside, 1e-12)[:, None] * (lens.fx, lens.fy)
    for k in range(len(lens.distortion)):
        slopes[:, :, 4 + k] = along * (angle ** (2 * k + 3))[:, None]
    return slopes
