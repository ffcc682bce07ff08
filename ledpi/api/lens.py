"""The lens, as a program knows it: OpenCV's and ROS's numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ledpi.config.values import check_lens
from ledpi.core.errors import ConfigError
from ledpi.core.records import Intrinsics

_COUNTS = (0, 4, 5)  # of coefficients


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """A pinhole camera with OpenCV's distortion (ROS: `plumb_bob`), in pixels of the pictures that are read.

    `distortion` is k1 k2 p1 p2 and, where there is a fifth, k3; empty for none.

    >>> Lens(fx=500, fy=500, cx=320, cy=240).distortion
    ()
    """

    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if len(self.distortion) not in _COUNTS:
            raise ConfigError(
                f"lens: distortion must be 4 or 5 numbers, k1 k2 p1 p2 (k3), or none, not {len(self.distortion)}"
            )

    @classmethod
    def from_matrix(cls, matrix: ArrayLike, distortion: ArrayLike = ()) -> Lens:
        """Of a 3 × 3 camera matrix, or its nine numbers: OpenCV's `cameraMatrix` and `distCoeffs`, ROS's `k` and `d`.

        Raises ConfigError for a matrix of another form.

        >>> Lens.from_matrix([[500, 0, 320], [0, 510, 240], [0, 0, 1]], [0.1, -0.05, 0, 0])
        Lens(fx=500.0, fy=510.0, cx=320.0, cy=240.0, distortion=(0.1, -0.05, 0.0, 0.0))
        """
        values, coefficients = np.asarray(matrix, np.float64), np.asarray(distortion, np.float64)
        if values.size != 9:
            raise ConfigError(f"lens: the camera matrix must be 3 × 3 or nine numbers, not {values.shape}")
        fx, skew, cx, zero, fy, cy, *last = values.ravel().tolist()
        if skew != 0 or zero != 0 or last != [0, 0, 1]:
            raise ConfigError("lens: the camera matrix must be [fx, 0, cx, 0, fy, cy, 0, 0, 1]")
        return cls(fx=fx, fy=fy, cx=cx, cy=cy, distortion=tuple(coefficients.ravel().tolist()))

    def for_size(self, width: int, height: int) -> Intrinsics:
        """As the decoder takes it. Raises ConfigError where no lens makes pictures of this size so."""
        k1, k2, p1, p2, k3 = [*self.distortion, 0.0, 0.0, 0.0, 0.0, 0.0][:5]
        try:
            check_lens(width, height, fx=self.fx, fy=self.fy, cx=self.cx, cy=self.cy)
            return Intrinsics(
                width=width,
                height=height,
                fx=self.fx,
                fy=self.fy,
                cx=self.cx,
                cy=self.cy,
                distortion=(k1, k2, p1, p2, k3),
            )
        except ValueError as error:
            raise ConfigError(f"lens: {error}") from None
