"""The lens, as a program knows it: OpenCV's and ROS's numbers, and the size of the pictures that they are for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ledpi.config.lens_forms import of_model
from ledpi.config.values import check_lens
from ledpi.core.errors import ConfigError
from ledpi.core.records import COEFFICIENTS, DistortionModel, Intrinsics


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """A camera and its lens by one of OpenCV's models, in pixels of pictures of `size` (width, height).

    Those are the pictures that it was calibrated with, and that are read: numbers of another size would give wrong
    distances. `distortion` is as OpenCV has it: k1 k2 p1 p2, k3, k4 k5 k6, s1 s2 s3 s4, as many as there are; empty for
    none. `model` says "equidistant" for the k1 k2 k3 k4 of `cv2.fisheye`, and must be given where there are four.

    Raises ConfigError for a lens that cannot be.

    >>> Lens(size=(640, 480), fx=500, fy=500, cx=320, cy=240).distortion
    ()
    """

    size: tuple[int, int]
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    model: DistortionModel | None = None

    def __post_init__(self) -> None:
        self.intrinsics()

    @classmethod
    def from_matrix(
        cls,
        matrix: ArrayLike,
        distortion: ArrayLike = (),
        *,
        size: tuple[int, int],
        model: DistortionModel | None = None,
    ) -> Lens:
        """Takes a 3 × 3 camera matrix, or nine numbers: OpenCV's `cameraMatrix` and `distCoeffs`, ROS's `k` and `d`.

        Raises ConfigError for a matrix of another form.

        >>> Lens.from_matrix([[500, 0, 320], [0, 510, 240], [0, 0, 1]], size=(640, 480))
        Lens(size=(640, 480), fx=500.0, fy=510.0, cx=320.0, cy=240.0, distortion=(), model=None)
        """
        values, coefficients = np.asarray(matrix, np.float64), np.asarray(distortion, np.float64)
        if values.size != 9:
            raise ConfigError(f"lens: the camera matrix must be 3 × 3 or nine numbers, not {values.shape}")
        fx, skew, cx, zero, fy, cy, *last = values.ravel().tolist()
        if skew != 0 or zero != 0 or last != [0, 0, 1]:
            raise ConfigError("lens: the camera matrix must be [fx, 0, cx, 0, fy, cy, 0, 0, 1]")
        bent = tuple(coefficients.ravel().tolist())
        return cls(size=size, fx=fx, fy=fy, cx=cx, cy=cy, distortion=bent, model=model)

    def intrinsics(self) -> Intrinsics:
        """As the decoder takes it. Raises ConfigError where no lens makes pictures of this size so."""
        width, height = _checked_size(self.size)
        if self.model is not None and self.model not in COEFFICIENTS:
            raise ConfigError(f"lens: model must be one of {', '.join(COEFFICIENTS)}, not {self.model!r}")
        try:
            model, distortion = of_model(self.model, self.distortion)
        except ValueError as error:
            raise ConfigError(f"lens: distortion {error}") from None
        try:
            check_lens(width, height, fx=self.fx, fy=self.fy, cx=self.cx, cy=self.cy)
            return Intrinsics(
                width=width,
                height=height,
                fx=self.fx,
                fy=self.fy,
                cx=self.cx,
                cy=self.cy,
                distortion=distortion,
                distortion_model=model,
            )
        except ValueError as error:
            raise ConfigError(f"lens: {error}") from None


def _checked_size(size: object) -> tuple[int, int]:
    try:
        width, height = (int(side) for side in size)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise ConfigError(f"lens: size must be (width, height) of the pictures, not {size!r}") from None
    if min(width, height) < 1:
        raise ConfigError(f"lens: size must be (width, height) of the pictures, not {size!r}")
    return width, height
