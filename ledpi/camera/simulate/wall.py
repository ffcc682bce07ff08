"""The background of everything: a made-up wall across the view, square to the scene's z axis, without end."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from ledpi.camera.simulate.optics import Blur, node_pixels, rays_of, spread, whole_picture
from ledpi.camera.simulate.scene import Room, SimulatedSensor
from ledpi.camera.simulate.surface import Image
from ledpi.camera.simulate.trajectory import Trajectory
from ledpi.core.records import Floats

_TEXELS = 1024
_SPAN = 1.6  # width of the painted picture over the wall's distance: about one texel a pixel at fx = 640
_MIN_COSINE = 0.05  # cosine to the wall's normal: beyond it, and behind, the wall goes on as it is there


class Wall:
    """The wall as one camera sees it, blurred as by its lens. The picture repeats itself, mirrored."""

    def __init__(self, room: Room, sensor: SimulatedSensor) -> None:
        self._distance_m = room.distance_m
        self._sensor = sensor
        lens = sensor.intrinsics
        self._pixels = node_pixels(whole_picture(lens))
        self._rays = np.column_stack([rays_of(self._pixels, lens), np.ones(len(self._pixels))])
        blur_texels = max(Blur.from_sensor(sensor).rms_px, 0.3) * _TEXELS / (_SPAN * lens.fx)
        self._painted: Image = np.asarray(cv2.GaussianBlur(_painted(room), (0, 0), blur_texels), np.float32)

    def seen(self, camera_motion: Trajectory, seq: int) -> Image:
        """(H, W) linear light, each row as at its mid-exposure; motion within the exposure is left out."""
        maps = spread(self._texels(camera_motion, seq), whole_picture(self._sensor.intrinsics))
        seen = cv2.remap(self._painted, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
        return np.asarray(seen, np.float32)

    def _texels(self, camera_motion: Trajectory, seq: int) -> Floats:
        """Returns where the node pixels see the painted picture: a quadratic in time through three of the rows."""
        last = self._sensor.intrinsics.height - 1.0
        at_rows = []
        for row in (0.0, last / 2.0, last):
            camera = camera_motion.scene_from_body(self._sensor.mid_exposure_s(seq, row))
            ahead = self._rays @ camera[:3, :3].T
            reach = (self._distance_m - camera[2, 3]) / np.maximum(ahead[:, 2:], _MIN_COSINE)
            at_rows.append((camera[:2, 3] + ahead[:, :2] * reach) / self._distance_m)
        first, middle, final = at_rows
        s = self._pixels[:, 1:] / last * 2.0 - 1.0
        on_wall = middle + s * (final - first) / 2.0 + s * s * ((final + first) / 2.0 - middle)
        return np.asarray(on_wall * (_TEXELS / _SPAN) + (_TEXELS - 1) / 2.0)


def _painted(room: Room) -> Image:
    """(_TEXELS, _TEXELS) levels."""
    picture = _picture(room.texture)
    return np.asarray(room.level * (1.0 + picture * (room.contrast / np.abs(picture).max())), np.float32)


@lru_cache(maxsize=1)  # one room is often photographed several times: with panels, with prints in their place
def _picture(texture: int) -> Image:
    """(_TEXELS, _TEXELS) of mean 0: blotches of every size, boards, frames, lines."""
    rng = np.random.default_rng((texture, 77))
    picture = np.zeros((_TEXELS, _TEXELS), np.float32)
    for octave in range(2, 9):
        grain = rng.standard_normal((2**octave, 2**octave)).astype(np.float32)
        picture += cv2.resize(grain, (_TEXELS, _TEXELS), interpolation=cv2.INTER_CUBIC) * 0.6**octave
    picture /= np.abs(picture).max()
    for _ in range(60):
        x, y = rng.integers(0, _TEXELS, 2)
        width, height = (int(v) for v in rng.integers(15, 220, 2))
        shade = float(rng.uniform(-0.8, 0.8))
        far = (int(x) + width, int(y) + height)
        cv2.rectangle(picture, (int(x), int(y)), far, shade, int(rng.choice([cv2.FILLED, 2, 6])), cv2.LINE_AA)
    for _ in range(120):
        x, y = rng.integers(0, _TEXELS, 2)
        dx, dy = rng.integers(-90, 90, 2)
        end = (int(x + dx), int(y + dy))
        shade, thick = float(rng.uniform(-0.9, 0.9)), int(rng.integers(1, 4))
        cv2.line(picture, (int(x), int(y)), end, shade, thick, cv2.LINE_AA)
    picture -= picture.mean()
    return picture
