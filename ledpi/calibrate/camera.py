"""Chessboard pictures → the camera's intrinsics, or the reason why they give none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from ledpi.errors import CalibrationError
from ledpi.records import Floats, Intrinsics, Pixels

MIN_VIEWS = 8  # below, one bad view is no longer told from the good ones
# A view is bad where its rms exceeds this many times the median of all. Good views of one camera lie
# between 0.7 and 1.6 times it (36 webcam photographs). Below CORNER_NOISE_PX nothing is told apart.
OUTLIER_RATIO = 2.5
CORNER_NOISE_PX = 0.1
MAX_RMS_PX = 1.0
MAX_FOCAL_DEVIATION = 0.01  # 1 % of focal length is 1 % of every distance
MIN_TILT_DEG = 10.0  # between the two most different views; frontal views alone fit any focal length
FIELD_OF_VIEW_DEG = (5.0, 150.0)
K3_SIGNIFICANT = 10.83  # χ² with one degree of freedom: one in a thousand by chance
_NO_CAMERA = "the views give no camera at all: are they of one flat, rigid board?"


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """A chessboard by its inner corners. Its size in metres does not matter for intrinsics."""

    columns: int
    rows: int

    def corners(self) -> Floats:
        """(columns·rows, 3): row by row, in squares, z = 0."""
        x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]).astype(np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardView:
    """A board that was found in a picture."""

    name: str
    corners_px: Floats  # (columns·rows, 2), in the order of Board.corners


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewError:
    """How well the camera model explains one view."""

    name: str
    rms_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraCalibration:
    """Intrinsics, and how far they can be trusted."""

    intrinsics: Intrinsics
    rms_px: float  # over all corners of the views used
    focal_sigma_px: float  # standard deviation of fx
    used: tuple[ViewError, ...]
    dropped: tuple[ViewError, ...]  # with the error for which each was dropped, the worst first


def find_board(picture: Pixels, board: Board) -> Floats | None:
    """Corners (columns·rows, 2) of the board in a grey picture, or None.

    OpenCV's sector-based detector: on 36 webcam photographs it leaves 0.11 px of rms where the classic one
    with cornerSubPix leaves 0.15 px, and it does not run away to a neighbouring corner.
    """
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    found, corners = cv2.findChessboardCornersSB(picture, (board.columns, board.rows), flags=flags)
    return np.asarray(corners, dtype=np.float64).reshape(-1, 2) if found else None


def calibrate_camera(views: Sequence[BoardView], board: Board, width: int, height: int) -> CameraCalibration:
    """Fits k1 k2 p1 p2, and k3 where the views show it; drops views that the others contradict, worst first.

    Raises CalibrationError where the views are too few or too much alike, or the result is not rational.
    """
    size = (width, height)
    kept, dropped, fit = _without_outliers(views, board, size)
    with_k3 = _fit(kept, board, size, 0)
    residuals = 2 * len(kept) * len(board.corners())
    # Likelihood ratio of nested models with a common, unknown noise.
    if residuals * math.log(fit.rms_px**2 / with_k3.rms_px**2) > K3_SIGNIFICANT:
        fit = with_k3
    _check(fit, size)
    return CameraCalibration(
        intrinsics=_intrinsics(fit, width, height),
        rms_px=fit.rms_px,
        focal_sigma_px=fit.focal_sigma_px,
        used=tuple(
            ViewError(name=view.name, rms_px=float(rms))
            for view, rms in zip(kept, fit.view_rms_px, strict=True)
        ),
        dropped=dropped,
    )


def _without_outliers(
    views: Sequence[BoardView], board: Board, size: tuple[int, int]
) -> tuple[list[BoardView], tuple[ViewError, ...], _Fit]:
    """The views that agree, those that do not, and the fit to the former (k3 = 0).

    One view at a time, because a bad one spoils the errors of the good ones as well.
    """
    kept = list(views)
    dropped: list[ViewError] = []
    while len(kept) >= MIN_VIEWS:
        fit = _fit(kept, board, size, cv2.CALIB_FIX_K3)
        worst = int(np.argmax(fit.view_rms_px))
        limit = OUTLIER_RATIO * max(float(np.median(fit.view_rms_px)), CORNER_NOISE_PX)
        if fit.view_rms_px[worst] <= limit:
            return kept, tuple(dropped), fit
        dropped.append(ViewError(name=kept.pop(worst).name, rms_px=float(fit.view_rms_px[worst])))
    raise CalibrationError(_too_few(len(views), dropped))


def _intrinsics(fit: _Fit, width: int, height: int) -> Intrinsics:
    k1, k2, p1, p2, k3 = fit.distortion.tolist()
    return Intrinsics(
        width=width,
        height=height,
        fx=float(fit.matrix[0, 0]),
        fy=float(fit.matrix[1, 1]),
        cx=float(fit.matrix[0, 2]),
        cy=float(fit.matrix[1, 2]),
        distortion=(k1, k2, p1, p2, k3),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Fit:
    rms_px: float
    matrix: Floats  # (3, 3)
    distortion: Floats  # (5,): k1 k2 p1 p2 k3
    focal_sigma_px: float
    view_rms_px: Floats  # (views,)
    normals: Floats  # (views, 3): the board's normal in the camera frame


def _fit(views: Sequence[BoardView], board: Board, size: tuple[int, int], flags: int) -> _Fit:
    """One run of OpenCV's (Zhang's) calibration. Raises CalibrationError where there is no solution."""
    objects: list[Any] = [board.corners().astype(np.float32)] * len(views)
    pictures: list[Any] = [view.corners_px.astype(np.float32) for view in views]
    try:
        rms, matrix, distortion, rotations, _, sigmas, _, errors = cv2.calibrateCameraExtended(
            objects, pictures, size, np.eye(3), np.zeros(5), flags=flags
        )
    except cv2.error:
        raise CalibrationError(_NO_CAMERA) from None
    return _Fit(
        rms_px=float(rms),
        matrix=np.asarray(matrix, dtype=np.float64),
        distortion=np.asarray(distortion, dtype=np.float64).ravel()[:5],
        focal_sigma_px=float(np.ravel(sigmas)[0]),
        view_rms_px=np.asarray(errors, dtype=np.float64).ravel(),
        normals=np.array([cv2.Rodrigues(rotation)[0][:, 2] for rotation in rotations]),
    )


def _too_few(found: int, dropped: Sequence[ViewError]) -> str:
    if not dropped:
        return (
            f"the board was found in only {found} pictures, at least {MIN_VIEWS} are needed: "
            "take them all over the field of view, tilted to different sides"
        )
    names = ", ".join(f"{view.name} {view.rms_px:.2f} px" for view in dropped)
    return (
        f"only {found - len(dropped)} of {found} views agree, at least {MIN_VIEWS} must "
        f"(left out: {names}): is the board flat, at rest, and sharp?"
    )


def _check(fit: _Fit, size: tuple[int, int]) -> None:
    """Raises CalibrationError where a result cannot be that of a real camera."""
    fx, fy, cx, cy = fit.matrix[0, 0], fit.matrix[1, 1], fit.matrix[0, 2], fit.matrix[1, 2]
    if not np.isfinite([fit.rms_px, fx, fy, cx, cy, *fit.distortion]).all() or fx <= 0 or fy <= 0:
        raise CalibrationError(_NO_CAMERA)
    if fit.rms_px > MAX_RMS_PX:
        raise CalibrationError(
            f"rms is {fit.rms_px:.2f} px, must be below {MAX_RMS_PX:g}: "
            "is the board flat, at rest and sharp, and are its inner corners counted right?"
        )
    tilt_deg = math.degrees(math.acos(np.clip((fit.normals @ fit.normals.T).min(), -1, 1)))
    if tilt_deg < MIN_TILT_DEG or fit.focal_sigma_px > MAX_FOCAL_DEVIATION * fx:
        raise CalibrationError(
            f"the views are too much alike (board tilted by {tilt_deg:.0f}° in all, fx {fx:.0f} ± "
            f"{fit.focal_sigma_px:.0f} px): take views tilted by 20° to 40° to different sides"
        )
    view_deg = math.degrees(2 * math.atan(size[0] / (2 * fx)))
    if not FIELD_OF_VIEW_DEG[0] <= view_deg <= FIELD_OF_VIEW_DEG[1] or not 0.8 < fx / fy < 1.25:
        raise CalibrationError(f"fx {fx:.0f} and fy {fy:.0f} px ({view_deg:.0f}° across) are no camera's")
    if not (0 <= cx < size[0] and 0 <= cy < size[1]):
        raise CalibrationError(f"the principal point ({cx:.0f}, {cy:.0f}) lies outside of the picture")
