"""A camera that moves toward two panels, and sees nothing once it is told so; a tap for its daemon."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from ledpi.camera.simulate.scene import SimulatedSensor
from ledpi.camera.simulate.scenes import ov5647_lens, still_scene
from ledpi.camera.simulate.trajectory import Trajectory
from ledpi.camera.simulated import SimulatedCamera
from ledpi.config.settings import Config
from ledpi.core.records import Frame, PanelSpec, Pixels, Rejected
from ledpi.daemon.observers import close_tap, open_tap
from ledpi.daemon.tap.server import Tap
from tests.builders.daemon import OtherCamera

SPEC = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
# Panels 7 and 23 stand 24 cm apart across the way, and 2 m ahead of where it begins: the map's origin.
MAP = """
deviations: {position_m: 0.003, angle_deg: 0.5}
panels:
  7: {position_m: [2, 0.12, 0], yaw_deg: 180}
  23: {position_m: [2, -0.12, 0], yaw_deg: 180}
"""


class Drive(OtherCamera):
    """The camera. It sees nothing while it is `dark`."""

    def __init__(self, motion: Trajectory) -> None:
        lens = ov5647_lens(320, 240)
        sensor = SimulatedSensor(intrinsics=lens, exposure_us=9966.32, row_time_us=33.67, frame_length_rows=1040)
        scene = still_scene(sensor, dict.fromkeys((7, 23), SPEC), "DICT_4X4_50", distance_m=2.0, angle_deg=0.0)
        super().__init__(SimulatedCamera(replace(scene, camera_motion=motion), seed=1, paced=True))
        self.began_ns = 0  # of the scene, CLOCK_MONOTONIC
        self.dark = False

    def read(self, into: Pixels) -> Frame | Rejected | None:
        frame = self._camera.read(into)
        if isinstance(frame, Frame):
            self.began_ns = frame.host_offset_ns
            if self.dark:
                into[:] = 0
        return frame


@contextmanager
def tap_of(config: Config) -> Iterator[Tap | None]:
    tap = open_tap(config)
    try:
        yield tap
    finally:
        close_tap(tap)
