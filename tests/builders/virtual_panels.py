"""The view of the virtual camera: three rendered panels, and the configuration that reads them."""

from __future__ import annotations

import numpy as np

from ledpi.camera.simulate.scenes import still_scene
from ledpi.camera.simulated import SimulatedCamera, simulated_sensor
from ledpi.config.settings import load_config
from ledpi.core.records import Frame, Pixels
from ledpi.pipeline.repeats import BUFFERS
from tests.builders.virtual_picamera2 import ROW_US

IDS = (7, 23, 41)
ROWS = 504
PERIOD_S = ROWS * ROW_US * 1e-6
# The virtual camera shows each picture four times, at times of its own: with whole cycles in a frame period the bands
# are those of any frame.
BLACK_HZ, WHITE_HZ = 20 / PERIOD_S, 39 / PERIOD_S
SETTINGS = (
    "panels.side_m=0.16",
    f"panels.black_hz={BLACK_HZ}",
    f"panels.white_hz={WHITE_HZ}",
    f"camera.row_time_us={ROW_US}",
    f"camera.frame_duration_us={ROWS * ROW_US}",
    "camera.transfer=linear",
)


# A frame that is lost shifts the round by one picture; the daemon refuses those that it kept as given by turns.
PICTURES = BUFFERS + 4


def rendered() -> list[Pixels]:
    """Frames of the panels, side by side at 0.75 m, each with noise of its own."""
    config = load_config(None, SETTINGS)
    specs = {marker_id: config.panels.spec(marker_id) for marker_id in IDS}
    sensor = simulated_sensor(config.camera, config.panels)
    scene = still_scene(sensor, specs, config.panels.dictionary, distance_m=0.75, angle_deg=0.0)
    camera = SimulatedCamera(scene, seed=0, paced=False)
    found = [np.zeros((480, 640), np.uint8) for _ in range(PICTURES)]
    assert all(isinstance(camera.read(into), Frame) for into in found)
    return found
