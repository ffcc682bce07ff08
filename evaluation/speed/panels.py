"""The time of a frame with 1 to 8 panels, searching and tracking, beside OpenCV's detectMarkers on the same frames.

Each frame is decoded three ways in turn, in one process, OpenCV on one thread; frames with 1 to 8 panels take turns,
so that what slows the machine down for a while slows all alike. Figures are medians of processor time, those of stages
(in brackets) of the clock's: to ask for the processor's at each costs as much as a stage.
"Searching": each frame alone. "Tracking": in a stream, once every panel was read. The last lines say what each further
panel costs.

    python -m evaluation.speed.panels [--panels 8] [--frames 24]
"""

from __future__ import annotations

import argparse
import itertools
import os
import time
from collections.abc import Iterator

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np

from ledpi.camera.simulate.render import Renderer
from ledpi.camera.simulate.scene import Scene, SimulatedSensor
from ledpi.camera.simulate.scenes import MOST_ABREAST, abreast_scene, ov5647_lens
from ledpi.camera.simulate.sensor import sensor_info
from ledpi.config.settings import load_config
from ledpi.core.records import Decoded, Frame
from ledpi.pipeline.pipeline import Pipeline

WARM_UP_FRAMES = 24  # squares that are no panels are looked at in each frame until then
THEIRS, OURS = "detectMarkers", ("searching", "tracking")
SETTINGS = load_config(None, ("panels.side_m=0.16",)).panels


def scene_of(count: int, exposure_us: float = 9966.0) -> Scene:
    specs = {marker_id: SETTINGS.spec(marker_id) for marker_id in sorted(SETTINGS.existing_ids())[:count]}
    sensor = SimulatedSensor(intrinsics=ov5647_lens(), exposure_us=exposure_us)
    return abreast_scene(sensor, specs, SETTINGS.dictionary)


def frames_of(scene: Scene, count: int) -> list[Frame]:
    renderer = Renderer(scene, seed=1)
    return [renderer.frame(seq) for seq in range(count)]


def pipeline_of(scene: Scene, *, stream: bool) -> Pipeline:
    return Pipeline(sensor_info(scene.sensor), SETTINGS, intrinsics=scene.sensor.intrinsics, stream=stream)


class Contest:
    """The same number of panels in every frame, decoded three ways: what each took, and what was read."""

    def __init__(self, count: int, frames: int) -> None:
        self.scene = scene_of(count)
        self.frames = frames_of(self.scene, WARM_UP_FRAMES + frames)
        self.pipelines = {name: pipeline_of(self.scene, stream=name == "tracking") for name in OURS}
        self.decoded: dict[str, list[Decoded]] = {name: [] for name in OURS}
        self.taken_ms: dict[str, list[float]] = {name: [] for name in (THEIRS, *OURS)}

    def decode(self, number: int, detector: cv2.aruco.ArucoDetector) -> None:
        """One frame, by all three in turn; while caches and tracks warm up it does not count."""
        frame, counts = self.frames[number], number >= WARM_UP_FRAMES
        starts = [time.thread_time()]
        detector.detectMarkers(frame.pixels)
        starts.append(time.thread_time())
        for name, pipeline in self.pipelines.items():
            decoded = pipeline.decode(frame)
            starts.append(time.thread_time())
            if counts:
                self.decoded[name].append(decoded)
        for name, (start, end) in zip(self.taken_ms, itertools.pairwise(starts), strict=True):
            if counts:
                self.taken_ms[name].append(1e3 * (end - start))

    def median_ms(self, name: str) -> float:
        return float(np.median(self.taken_ms[name]))

    def lines(self) -> Iterator[str]:
        """Says how long it took, beside detectMarkers, and where the time goes."""
        count, theirs = len(self.scene.panels), self.median_ms(THEIRS)
        for name, decoded in self.decoded.items():
            read = sum(len(each.markers) for each in decoded)
            stages = [f"{s} {np.median([each.stage_ms[s] for each in decoded]):.2f}" for s in decoded[0].stage_ms]
            yield (
                f"{count} panels, {name:9} read {read}/{count * len(decoded)}  {self.median_ms(name):5.2f} ms, "
                f"{self.median_ms(name) / theirs:.2f} of detectMarkers' {theirs:.2f} ms  ({', '.join(stages)})"
            )


def contests_of(most: int, frames: int) -> list[Contest]:
    """Run with 1 to `most` panels, frame by frame in turn."""
    cv2.setNumThreads(1)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    contests = [Contest(count, frames) for count in range(1, most + 1)]
    for number in range(WARM_UP_FRAMES + frames):
        for contest in contests:
            contest.decode(number, detector)
    return contests


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--panels", type=int, default=MOST_ABREAST, choices=range(2, MOST_ABREAST + 1))
    parser.add_argument("--frames", type=int, default=24)
    arguments = parser.parse_args()
    contests = contests_of(arguments.panels, arguments.frames)
    print(*(line for contest in contests for line in contest.lines()), sep="\n")
    theirs = float(np.median([contest.median_ms(THEIRS) for contest in contests]))
    for name in OURS:
        ms = [contest.median_ms(name) for contest in contests]
        slope = float(np.polyfit(range(len(ms)), ms, 1)[0])  # of a straight line through the times
        print(f"each further panel, {name}: {slope:.2f} ms, {slope / theirs:.2f} of detectMarkers")


if __name__ == "__main__":
    main()
