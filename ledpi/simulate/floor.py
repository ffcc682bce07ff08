"""A glossy floor's image: each surface upside down, dimmer, and a little blurred."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ledpi.core.records import Floats
from ledpi.simulate.scene import Floor
from ledpi.simulate.surface import Image, Surface
from ledpi.simulate.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class _Mirrored:
    """The motion of a mirror image below the level y = `y_m`.

    A mirror image is no turned body, but that of the body with left and right swapped is: its x axis is negated.
    """

    body: Trajectory
    y_m: float

    @property
    def moves(self) -> bool:
        return self.body.moves

    def scene_from_body(self, t_s: float) -> Floats:
        up_is_down = np.diag([1.0, -1.0, 1.0, 1.0])
        up_is_down[1, 3] = 2.0 * self.y_m
        return np.asarray(up_is_down @ self.body.scene_from_body(t_s) @ np.diag([-1.0, 1.0, 1.0, 1.0]))


def mirrored(surface: Surface, floor: Floor) -> Surface:
    """Returns what the floor shows of a surface: light on top of the floor's own, in the same waves."""
    *lights, opacity = surface.planes
    sigma = max(floor.blur * lights[0].shape[1], 0.1)
    pad = int(np.ceil(3.0 * sigma))
    shown = [_blurred(np.pad(light[:, ::-1], pad) * np.float32(floor.reflectance), sigma) for light in lights]
    height, width = opacity.shape
    size_m = (surface.size_m[0] * (1 + 2 * pad / width), surface.size_m[1] * (1 + 2 * pad / height))
    motion = _Mirrored(surface.motion, floor.y_m)
    return replace(surface, planes=(*shown, np.zeros_like(shown[0])), size_m=size_m, motion=motion, _levels={})


def _blurred(light: Image, sigma: float) -> Image:
    return np.asarray(cv2.GaussianBlur(light, (0, 0), sigma), np.float32)
