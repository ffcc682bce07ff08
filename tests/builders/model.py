"""A panel's picture by the equation of docs/algorithm.md, in numpy: what the fit in C is held to."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.special import erf

from ledpi.core.records import Floats, Frame
from ledpi.decode.model.fit import Fitted
from ledpi.decode.model.light import Window
from tests.builders.decode import PHASES, SPEC, TRUE_10_MS_US, Canvas, share_on, word

CELLS = 4
SIZE = 160  # of a picture, pixels along a side
PICTURE = (480, 640)  # rows and columns of what that is a part of
FOCAL_PX, CENTRE_PX = 640.0, (320.0, 240.0)  # what the fit takes for a camera that it does not know, of 640 × 480


@dataclass(frozen=True, kw_only=True)
class Panel:
    """A panel's picture, and all that it depends on."""

    corners: Floats  # (4, 2) of the lattice of cells
    exposure_us: float = TRUE_10_MS_US
    blur_px: float = 0.8
    gap: float = 0.08  # between cells, in cells
    rim: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # left, right, above, below, in cells
    hot: float = 0.3  # first harmonic of a cell's light, either way
    hot_at: float = 0.5  # where in a cell that is brightest, across and down
    leds: int = 1  # along a cell: each makes such a spot
    depth: float = 0.0  # that walls stand before the diffuser, in cells
    glow: float = 0.4  # of a wall's face, over the diffuser beside it
    gains: Floats | None = None  # (4, 4)
    blinks: bool = True
    phases: tuple[float, float] = PHASES
    beside: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # levels left, right, above, below
    dark: float = 0.03
    marker_id: int = 7

    def light(self) -> Floats:
        """(SIZE, SIZE), in units of a cell's light, its mean over blinking."""
        across, down = places_of(self.corners, np.stack(np.indices((SIZE, SIZE))[::-1], axis=-1))
        own = np.ones((CELLS, CELLS)) if self.gains is None else self.gains
        shown = own[..., None] * (1.0 + self._waves()[word(self.marker_id).astype(int)])  # (4, 4, SIZE)
        shifts = self.depth * sight_of(self.corners)
        open_across, left, right = self._openings(across, self.rim[:2], shifts[0])
        open_down, above, below = self._openings(down, self.rim[2:], shifts[1])
        light = np.full((SIZE, SIZE), self.dark)
        for j in range(CELLS):
            for i in range(CELLS):
                profile = self._profile(across + shifts[0] - i, down + shifts[1] - j)
                light += open_down[j] * open_across[i] * shown[j, i][:, None] * profile
        between = 1.0 - left - right
        beside = [left, right, above * between, below * between]
        light += sum(level * share for level, share in zip(self.beside, beside, strict=True))
        return light

    def _profile(self, x: Floats, y: Floats) -> Floats:
        places = (np.clip(at, 0.0, 1.0) - self.hot_at for at in (x, y))
        return 1.0 + self.hot * sum(np.cos(self.leds * math.tau * at) for at in places)

    def _openings(self, at: Floats, rim: tuple[float, float], shift: float) -> tuple[list[Floats], Floats, Floats]:
        """Returns how open each cell is along one axis, how much is before the first one, and how much after the last.

        Sight ends `shift` further on: at one end of each cell, so much of it on a wall's face.
        """
        sigma = self.blur_px * np.hypot(*np.gradient(at))

        def after(line: float) -> Floats:
            return np.asarray(0.5 * (1.0 + erf((at - line) / (math.sqrt(2.0) * sigma))))

        starts = [rim[0], *(k + self.gap / 2 for k in range(1, CELLS))]
        ends = [*(k - self.gap / 2 for k in range(1, CELLS)), CELLS - rim[1]]
        before, beyond = max(-shift, 0.0), max(shift, 0.0)
        openings = [
            self.glow * (after(start) - after(end)) + (1.0 - self.glow) * (after(start + before) - after(end - beyond))
            for start, end in zip(starts, ends, strict=True)
        ]
        return openings, 1.0 - after(starts[0]), after(ends[-1])

    def _waves(self) -> Floats:
        """(2, SIZE) what a row shows of black's and white's wave, less its mean, over its mean."""
        if not self.blinks:
            return np.zeros((2, SIZE))
        waves = [
            share_on(np.arange(SIZE), hz, phase, exposure_us=self.exposure_us, duty=SPEC.duty, start_us=0.0)
            for hz, phase in zip(SPEC.waves_hz, self.phases, strict=True)
        ]
        return np.stack(waves) / SPEC.duty - 1.0

    def frame(self) -> Frame:
        """For what the fit asks of a frame: its times. Its picture is empty."""
        return Canvas(exposure_us=self.exposure_us).frame(None)


def window_of(light: Floats, *, noise: float = 0.0, seed: int = 0, dark: float = 0.03) -> Window:
    """All of a picture, unquantised; `noise`: its deviation at a level of 1, as the fit weighs light."""
    deviation = noise * np.sqrt(np.maximum(light, 0.0) + 0.1)
    seen = light + deviation * np.random.default_rng(seed).standard_normal(light.shape)
    own, lit = 0.25 * dark, 0.25 * (1.0 + dark)
    return Window((0.25 * seen).astype(np.float32), (0.0, 0.0), 1, PICTURE, own, lit, own)


def places_of(corners: Floats, at_px: Floats) -> Floats:
    """(2, …) places in cells from the first corner, across and down, of points (…, 2) in the picture."""
    ends = CELLS * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    rows = []
    for (x, y), (u, v) in zip(corners, ends, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
    h = np.append(np.linalg.solve(np.array(rows), ends.reshape(-1)), 1.0).reshape(3, 3)
    at = np.concatenate([at_px, np.ones((*at_px.shape[:-1], 1))], axis=-1) @ h.T
    return np.stack([at[..., 0] / at[..., 2], at[..., 1] / at[..., 2]])


def projected(yaw_deg: float) -> Floats:
    """(4, 2) corners of a panel that is turned about its height, and 90 px high, as that camera sees it."""
    turn = cv2.Rodrigues(np.array([0.0, math.radians(yaw_deg), 0.0]))[0] @ cv2.Rodrigues(np.array([0.0, 0.0, 0.1]))[0]
    at = np.array([80.3, 80.6, FOCAL_PX]) - [*CENTRE_PX, 0.0]
    sides = 45.0 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) @ turn.T + at
    return np.asarray(FOCAL_PX * sides[:, :2] / sides[:, 2:] + CENTRE_PX)


def sight_of(corners: Floats) -> Floats:
    """(2,) how far aside, across and down, a line of sight to the panel's middle goes for each step inwards."""
    ends = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float64)
    camera = np.array([[FOCAL_PX, 0, CENTRE_PX[0]], [0, FOCAL_PX, CENTRE_PX[1]], [0, 0, 1]])
    _, turn, move = cv2.solvePnP(ends, corners, camera, np.zeros(4))
    middle = cv2.Rodrigues(turn)[0].T @ (cv2.Rodrigues(turn)[0] @ [[0.5], [0.5], [0.0]] + move)
    return np.asarray(middle[:2, 0] / abs(middle[2, 0]))


def nees(fit: Fitted, corners: Floats) -> float:
    """The square of the eight coordinates' errors, normalised by their covariance: 8 on average where that is right."""
    error = (fit.corners_px - corners).reshape(8)
    return float(error @ np.linalg.solve(fit.covariance_px2, error))
