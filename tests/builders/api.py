"""Pictures for the Python interface: a panel before a camera at rest."""

from __future__ import annotations

import numpy as np

from ledpi import Lens
from ledpi.camera.simulate.scene import SimulatedSensor
from ledpi.camera.simulate.scenes import ov5647_lens, still_scene
from ledpi.camera.simulated import SimulatedCamera
from ledpi.core.records import Frame, PanelSpec, Pixels

INTRINSICS = ov5647_lens()
LENS = Lens.from_matrix(INTRINSICS.matrix(), INTRINSICS.distortion, size=(640, 480))
ROW_TIME_US = 33.67
SPEC = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)


def pictures(count: int, *, distance_m: float, yaw_deg: float = 20.0) -> list[tuple[Pixels, int]]:
    """Yields those of panel 7: each with when its row 0's read-out began, in ns."""
    sensor = SimulatedSensor(intrinsics=INTRINSICS, exposure_us=9966.32, row_time_us=ROW_TIME_US, frame_length_rows=507)
    scene = still_scene(sensor, {7: SPEC}, "DICT_4X4_50", distance_m=distance_m, angle_deg=yaw_deg)
    camera, taken = SimulatedCamera(scene, seed=1, paced=False), []
    for _ in range(count):
        into = np.empty((480, 640), np.uint8)
        frame = camera.read(into)
        assert isinstance(frame, Frame)
        taken.append((into, frame.row0_readout_ns))
    return taken
