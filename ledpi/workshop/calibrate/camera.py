"""Views of a board → the camera's intrinsics, or the reason why they give none."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import cv2
import numpy as np

from ledpi.core.errors import CalibrationError
from ledpi.core.lens import blind_part
from ledpi.core.records import COEFFICIENTS, DistortionModel, Floats, Intrinsics
from ledpi.workshop.calibrate.boards import Board, BoardView
from ledpi.workshop.calibrate.fisheye import fit_fisheye

MIN_VIEWS = 8  # below, one bad view is no longer told from the good ones
# A view is bad where its rms exceeds this many times the median of all. Good views of one camera lie
# between 0.7 and 1.6 times it (36 webcam photographs). Below CORNER_NOISE_PX nothing is told apart.
OUTLIER_RATIO = 2.5
CORNER_NOISE_PX = 0.1
MODEL_NOISE = 2.0  # times the noise of corners: what is left beyond that may be the model's
MAX_RMS_PX = 1.0
MAX_FOCAL_DEVIATION = 0.01  # 1 % of focal length is 1 % of every distance
MIN_TILT_DEG = 10.0  # between the two most different views; frontal views alone fit any focal length
FLAGS = {"rational_polynomial": cv2.CALIB_RATIONAL_MODEL, "thin_prism": cv2.CALIB_THIN_PRISM_MODEL}
FIELD_OF_VIEW_DEG = (5.0, 220.0)
K3_SIGNIFICANT = 10.83  # χ² with one degree of freedom: one in a thousand by chance
_NO_CAMERA = "the views give no camera at all: are they of one flat, rigid board?"


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewError:
    """The errors of the camera model in one view."""

    name: str
    rms_px: float
    corners_px: Floats  # (N, 2) where they were found
    residuals_px: Floats  # (N, 2) from where the model has them to there


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraCalibration:
    """Intrinsics, and how far they can be trusted."""

    intrinsics: Intrinsics
    rms_px: float  # over all corners of the views used
    deviations: Floats  # standard deviations of fx fy cx cy (px) and each coefficient
    used: tuple[ViewError, ...]
    dropped: tuple[ViewError, ...]  # with the error for which each was dropped, the worst first


def calibrate_camera(
    views: Sequence[BoardView], board: Board, width: int, height: int, model: DistortionModel | None = None
) -> CameraCalibration:
    """Fits a plumb_bob lens or, where that does not explain the views, an equidistant one: a fisheye.

    Of plumb_bob k1 k2 p1 p2, and k3 where the views show it. `model`: that one, and no other. Drops views that the
    others contradict, worst first.
    Raises CalibrationError where the views are too few or too much alike, or the result is not rational.
    """
    size = (width, height)
    if model is not None:
        return _calibrated(_of_model(model, views, board, size), size)
    try:
        plain = _calibrated(_plumb_bob(views, board, size), size)
    except CalibrationError as error:
        fisheye = _fisheye(views, board, size)
        if fisheye is None:
            raise error from None
        return _calibrated(fisheye, size)
    if plain.rms_px <= MODEL_NOISE * CORNER_NOISE_PX and not plain.dropped and not blind_part(plain.intrinsics)[0]:
        return plain
    fisheye = _fisheye(views, board, size)
    return plain if fisheye is None or not _explains_more(fisheye, plain) else _calibrated(fisheye, size)


def _explains_more(fisheye: _Kept, plain: CameraCalibration) -> bool:
    """By more than the noise of corners, or of more views; or where plumb_bob folds within the picture."""
    _, dropped, fit = fisheye
    if blind_part(plain.intrinsics)[0] and fit.rms_px <= plain.rms_px + CORNER_NOISE_PX:
        return True
    less = math.hypot(fit.rms_px, CORNER_NOISE_PX) < plain.rms_px
    return less if len(dropped) == len(plain.dropped) else len(dropped) < len(plain.dropped)


def _of_model(model: DistortionModel, views: Sequence[BoardView], board: Board, size: tuple[int, int]) -> _Kept:
    """Raises CalibrationError where there is no such lens."""
    if model == "plumb_bob":
        return _plumb_bob(views, board, size)
    if model == "equidistant":
        fisheye = _fisheye(views, board, size)
        if fisheye is None:
            raise CalibrationError(f"no {model} lens explains the views; try without --model")
        return fisheye
    return _drop_outliers(views, lambda some: _fit(some, board, size, FLAGS[model], model))


def _plumb_bob(views: Sequence[BoardView], board: Board, size: tuple[int, int]) -> _Kept:
    kept, dropped, fit = _drop_outliers(views, lambda some: _fit(some, board, size, cv2.CALIB_FIX_K3))
    with_k3 = _fit(kept, board, size, 0)
    residuals = 2 * sum(len(view.corner_ids) for view in kept)
    # Likelihood ratio of nested models with a common, unknown noise.
    if residuals * math.log(fit.rms_px**2 / with_k3.rms_px**2) > K3_SIGNIFICANT:
        fit = with_k3
    return kept, dropped, fit


def _fisheye(views: Sequence[BoardView], board: Board, size: tuple[int, int]) -> _Kept | None:
    """None where there is no such lens, or it is no better than nonsense."""
    corners = board.corners()

    def fit(some: Sequence[BoardView]) -> _Fit:
        found = fit_fisheye([corners[v.corner_ids] for v in some], [v.corners_px for v in some], size)
        if found is None:
            raise CalibrationError(_NO_CAMERA)
        squares = [(left * left).sum(axis=1) for left in found.residuals_px]
        return _Fit(
            rms_px=float(np.sqrt(np.concatenate(squares).mean())),
            lens=found.lens,
            deviations=found.deviations,
            view_rms_px=np.array([math.sqrt(of_view.mean()) for of_view in squares]),
            normals=np.array([turn[:, 2] for turn in found.rotations]),
            residuals_px=found.residuals_px,
        )

    try:
        kept, dropped, best = _drop_outliers(views, fit)
        _check(best, size)
    except CalibrationError:
        return None
    return kept, dropped, best


def _calibrated(found: _Kept, size: tuple[int, int]) -> CameraCalibration:
    kept, dropped, fit = found
    _check(fit, size)
    return CameraCalibration(
        intrinsics=fit.lens,
        rms_px=fit.rms_px,
        deviations=fit.deviations,
        used=tuple(fit.error_of(i, view) for i, view in enumerate(kept)),
        dropped=dropped,
    )


def quality(result: CameraCalibration) -> dict[str, Any]:
    """Says how good it is, as camera.yaml tells."""
    return {
        "rms_px": round(result.rms_px, 4),
        "views": len(result.used),
        "deviations": {
            name: float(f"{sigma:.2g}")
            for name, sigma in zip(parameters(result.intrinsics), result.deviations, strict=True)
        },
    }


def parameters(lens: Intrinsics) -> tuple[str, ...]:
    """Their names, in the order of the deviations."""
    return ("fx", "fy", "cx", "cy", *COEFFICIENTS[lens.distortion_model])


def _drop_outliers(views: Sequence[BoardView], fitted: Callable[[Sequence[BoardView]], _Fit]) -> _Kept:
    """The views that agree, the others, worst first, and the fit; one at a time, as a bad one spoils the good."""
    kept = list(views)
    dropped: list[ViewError] = []
    while len(kept) >= MIN_VIEWS:
        fit = fitted(kept)
        worst = int(np.argmax(fit.view_rms_px))
        limit = OUTLIER_RATIO * max(float(np.median(fit.view_rms_px)), CORNER_NOISE_PX)
        if fit.view_rms_px[worst] <= limit:
            return kept, tuple(dropped), fit
        dropped.append(fit.error_of(worst, kept.pop(worst)))
    raise CalibrationError(_too_few(len(views), dropped))


def _intrinsics(matrix: Floats, distortion: Floats, size: tuple[int, int], model: DistortionModel) -> Intrinsics:
    """Raises CalibrationError where it is none."""
    try:
        return Intrinsics(
            width=size[0],
            height=size[1],
            fx=float(matrix[0, 0]),
            fy=float(matrix[1, 1]),
            cx=float(matrix[0, 2]),
            cy=float(matrix[1, 2]),
            distortion=tuple(distortion.tolist()),
            distortion_model=model,
        )
    except ValueError:
        raise CalibrationError(_NO_CAMERA) from None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Fit:
    rms_px: float
    lens: Intrinsics
    deviations: Floats
    view_rms_px: Floats  # (views,)
    normals: Floats  # (views, 3): the board's normal in the camera frame
    residuals_px: tuple[Floats, ...]  # of each view (N, 2)

    def error_of(self, index: int, view: BoardView) -> ViewError:
        return ViewError(
            name=view.name,
            rms_px=float(self.view_rms_px[index]),
            corners_px=view.corners_px,
            residuals_px=self.residuals_px[index],
        )


def _fit(
    views: Sequence[BoardView], board: Board, size: tuple[int, int], flags: int, model: DistortionModel = "plumb_bob"
) -> _Fit:
    """One run of OpenCV's (Zhang's) calibration. Raises CalibrationError where there is no solution."""
    corners = board.corners().astype(np.float32)
    objects: list[Any] = [corners[view.corner_ids] for view in views]
    pictures: list[Any] = [view.corners_px.astype(np.float32) for view in views]
    count = len(COEFFICIENTS[model])
    try:
        rms, matrix, distortion, rotations, shifts, sigmas, _, errors = cv2.calibrateCameraExtended(
            objects, pictures, size, np.eye(3), np.zeros(count), flags=flags
        )
    except cv2.error:
        raise CalibrationError(_NO_CAMERA) from None
    explained = [
        cv2.projectPoints(points, turn, shift, matrix, distortion)[0].reshape(-1, 2)
        for points, turn, shift in zip(objects, rotations, shifts, strict=True)
    ]
    return _Fit(
        rms_px=float(rms),
        lens=_intrinsics(
            np.asarray(matrix, np.float64), np.asarray(distortion, np.float64).ravel()[:count], size, model
        ),
        deviations=np.asarray(sigmas, dtype=np.float64).ravel()[: 4 + count],
        view_rms_px=np.asarray(errors, dtype=np.float64).ravel(),
        normals=np.array([cv2.Rodrigues(rotation)[0][:, 2] for rotation in rotations]),
        residuals_px=tuple(view.corners_px - points for view, points in zip(views, explained, strict=True)),
    )


_Kept: TypeAlias = (
    "tuple[list[BoardView], tuple[ViewError, ...], _Fit]"  # that agree; that do not; the fit to the former
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
    fx, fy, cx, cy = fit.lens.fx, fit.lens.fy, fit.lens.cx, fit.lens.cy
    if not math.isfinite(fit.rms_px):
        raise CalibrationError(_NO_CAMERA)
    if fit.rms_px > MAX_RMS_PX:
        raise CalibrationError(
            f"rms is {fit.rms_px:.2f} px, must be below {MAX_RMS_PX:g}: "
            "is the board flat, at rest and sharp, and are its inner corners counted right?"
        )
    tilt_deg = math.degrees(math.acos(np.clip((fit.normals @ fit.normals.T).min(), -1, 1)))
    if tilt_deg < MIN_TILT_DEG or fit.deviations[0] > MAX_FOCAL_DEVIATION * fx:
        raise CalibrationError(
            f"the views are too much alike (board tilted by {tilt_deg:.0f}° in all, fx {fx:.0f} ± "
            f"{fit.deviations[0]:.0f} px): take views tilted by 20° to 40° to different sides"
        )
    is_fisheye = fit.lens.distortion_model == "equidistant"
    view_deg = math.degrees(size[0] / fx if is_fisheye else 2 * math.atan(size[0] / (2 * fx)))
    if not FIELD_OF_VIEW_DEG[0] <= view_deg <= FIELD_OF_VIEW_DEG[1] or not 0.8 < fx / fy < 1.25:
        raise CalibrationError(f"fx {fx:.0f} and fy {fy:.0f} px ({view_deg:.0f}° across) are no camera's")
    if not (0 <= cx < size[0] and 0 <= cy < size[1]):
        raise CalibrationError(f"the principal point ({cx:.0f}, {cy:.0f}) lies outside of the picture")
