"""A daemon on a camera at rest that sees panel 7, and panel 11 whose two frequencies are swapped: FOLDER/tap.sock."""

from __future__ import annotations

import signal
import sys
from dataclasses import asdict, replace

from ledpi.camera.simulated import SimulatedCamera, simulated_sensor
from ledpi.config.settings import load_config
from ledpi.core.records import PanelValues
from ledpi.runtime.service import Service
from ledpi.simulate.scenes import still_scene


def main() -> None:
    """Until SIGTERM."""
    folder = sys.argv[1]
    given = (f"tap.socket={folder}/tap.sock", f"serial.port={folder}/none", "camera.source=simulated")
    config = load_config(None, ("panels.side_m=0.16", *given))
    right = config.panels.spec()
    swapped = replace(right, black_hz=right.white_hz, white_hz=right.black_hz)
    sensor = simulated_sensor(config.camera, config.panels)
    scene = still_scene(sensor, {7: right, 11: swapped}, config.panels.dictionary, distance_m=1.0, angle_deg=20.0)
    values = PanelValues(dictionary=config.panels.dictionary, **asdict(right))
    service = Service(lambda: config, lambda _: SimulatedCamera(scene, seed=1, paced=True, panel=values))
    signal.signal(signal.SIGTERM, lambda *_: service.stop())
    service.run()


if __name__ == "__main__":
    main()
