"""How long a frame with 1 to 8 panels takes, searching and tracking, beside OpenCV's detectMarkers on the same frames.

Each frame is decoded three ways in turn, in one process, OpenCV on one thread; figures are medians of processor time,
those of stages (in brackets) of the clock's: to ask for the processor's at each costs as much as a stage.
"Searching": each frame alone. "Tracking": in a stream, once every panel was read. The last lines say what each further
panel costs.

    python benchmarks/panels.py [--panels 8] [--frames 24]
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np

from ledpi.config import load_config
from ledpi.dictionaries import load_dictionary
from ledpi.pipeline import Pipeline
from ledpi.records import CameraInfo, Frame
from ledpi.simulate.render import Renderer
from ledpi.simulate.scene import Panel, Room, Scene, SimulatedSensor
from ledpi.simulate.scenes import ov5647_lens
from ledpi.simulate.trajectory import Still, facing_camera

DISTANCE_M = 1.4
WARM_UP_FRAMES = 24  # squares that are no panels are looked at in each frame until then
SETTINGS = load_config(None, ("panels.side_m=0.16",)).panels
PLACES_M = [(x, y) for y in (-0.22, 0.22) for x in (-0.45, -0.15, 0.15, 0.45)]  # four across, two down


def scene_of(count: int) -> Scene:
    words = load_dictionary(SETTINGS.dictionary).words
    panels = [
        Panel(
            word=words[k],
            spec=SETTINGS.spec(k),
            motion=Still(facing_camera(np.array([*PLACES_M[k], DISTANCE_M]), roll_deg=5.0 * k)),
            marker_id=k,
        )
        for k in range(count)
    ]
    sensor = SimulatedSensor(intrinsics=ov5647_lens(), exposure_us=9966.0)
    return Scene(sensor=sensor, panels=tuple(panels), room=Room(distance_m=3.0))


def frames_of(scene: Scene, count: int) -> list[Frame]:
    renderer = Renderer(scene, seed=1)
    return [renderer.frame(seq) for seq in range(count)]


def pipeline_of(scene: Scene, *, stream: bool) -> Pipeline:
    sensor = scene.sensor
    info = CameraInfo(
        width=640,
        height=480,
        exposure_us=sensor.exposure_us,
        row_time_us=sensor.row_time_us,
        transfer=sensor.transfer,
        frame_length_rows=sensor.frame_length_rows,
    )
    return Pipeline(info, SETTINGS, intrinsics=sensor.intrinsics, stream=stream)


def measure(count: int, frames: int) -> tuple[float, float, float]:
    """Median milliseconds of detectMarkers, of searching, of tracking; prints where the time goes."""
    scene = scene_of(count)
    searching, tracking = pipeline_of(scene, stream=False), pipeline_of(scene, stream=True)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    taken: dict[str, list[float]] = {"detectMarkers": [], "searching": [], "tracking": []}
    stages: dict[str, list[dict[str, float]]] = {"searching": [], "tracking": []}
    read = {"searching": 0, "tracking": 0}
    for number, frame in enumerate(frames_of(scene, WARM_UP_FRAMES + frames)):
        start = time.thread_time()
        detector.detectMarkers(frame.pixels)
        taken["detectMarkers"].append(1e3 * (time.thread_time() - start))
        for name, pipeline in (("searching", searching), ("tracking", tracking)):
            start = time.thread_time()
            decoded = pipeline.decode(frame)
            taken[name].append(1e3 * (time.thread_time() - start))
            stages[name].append(decoded.stage_ms)
            read[name] += len(decoded.markers) if number >= WARM_UP_FRAMES else 0
    medians = {name: float(np.median(ms[WARM_UP_FRAMES:])) for name, ms in taken.items()}
    for name in ("searching", "tracking"):
        parts = [(s, np.median([ms[s] for ms in stages[name][WARM_UP_FRAMES:]])) for s in stages[name][0]]
        print(
            f"{count} panels, {name:9} read {read[name]}/{count * frames}  {medians[name]:5.2f} ms, "
            f"{medians[name] / medians['detectMarkers']:.2f} of detectMarkers' {medians['detectMarkers']:.2f} ms  "
            f"({', '.join(f'{s} {ms:.2f}' for s, ms in parts)})"
        )
    return medians["detectMarkers"], medians["searching"], medians["tracking"]


def further_panel(counts: Sequence[int], ms: Sequence[float]) -> float:
    """Slope of a straight line through the times, in milliseconds a panel."""
    return float(np.polyfit(counts, ms, 1)[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--panels", type=int, default=len(PLACES_M), choices=range(2, len(PLACES_M) + 1))
    parser.add_argument("--frames", type=int, default=24)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    counts = range(1, arguments.panels + 1)
    times = [measure(count, arguments.frames) for count in counts]
    theirs = float(np.median([detect for detect, _, _ in times]))
    for name, column in (("searching", 1), ("tracking", 2)):
        slope = further_panel(counts, [row[column] for row in times])
        print(f"each further panel, {name}: {slope:.2f} ms, {slope / theirs:.2f} of detectMarkers")


if __name__ == "__main__":
    main()
