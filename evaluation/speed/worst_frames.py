"""The worst for the decoder, beside a panel that can be read: poses a second, the longest frame, a newcomer.

Scenes full of what looks like panels at first (packed grids, window panes, a keyboard, 128 squares, LED matrices, text,
noise), or of panels, stand around a panel, and wobble by a pixel a frame; after half of the time a second panel comes
among them. Each scene is decoded as the daemon would: a camera delivers a frame each period, the decoder takes the
newest as soon as it is free, and its budget follows from how long frames take. Time is the decoding thread's processor
time, --slower times as much for a slower processor, so that what else this machine does changes little. Pictures are
drawn outside of it.

A line a scene: poses of the panel a second, and as a share of those where it is alone; the first frame and the longest
later one, in frame periods; when the second panel is read, in frames; the longest time between two feeds of the
watchdog that this allows. Exit status 1 where a scene misses an aim: a share of 90 %, 1.5 periods, one second for
the second panel, 2 s for the watchdog.

    python -m evaluation.speed.worst_frames [--seconds 3] [--slower 1] [--only 640x480/600/4X4_50/squares] [--draw 0]
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np

from evaluation.endurance.hostile_frames import Blink
from evaluation.endurance.hostile_pictures import (
    Drawing,
    Rng,
    keyboard,
    matrix,
    noise,
    packed,
    put_panel,
    squares,
    text,
    window,
)
from ledpi.camera.base import frame_by
from ledpi.camera.simulate.scenes import ov5647_lens
from ledpi.camera.timing import choose_frame_length_rows
from ledpi.config.panels import PanelSettings
from ledpi.core.records import CameraInfo, Decoded, Floats, Frame, Singles
from ledpi.daemon.daemon import TICK_S
from ledpi.daemon.liveness import Pacing
from ledpi.daemon.reporting import FEEDS
from ledpi.pipeline.pipeline import Pipeline

# The OV5647's: rows, and the least rows of a frame (hts 1852 at 55 MHz, 1896 at 87.5 MHz; `vts` less its blanking).
SENSORS = {(640, 480): (33.67, 504), (1296, 972): (21.67, 996)}
EXPOSURES_US = (10_000.0, 600.0, 150.0)
DICTIONARIES = ("4X4_50", "4X4_1000")
FIRST, SECOND = 7, 23  # IDs
PLACES = {FIRST: (0.3, 0.3, 0.2), SECOND: (0.7, 0.65, 0.12)}  # middle, in widths and heights, and side, in heights
OTHERS = (11, 12, 13, 15, 16, 18, 19, 20, 21, 24)  # of `room`: above, in the middle, below
MIDDLES = *((x, y) for y in (0.12, 0.38) for x in (0.55, 0.75, 0.92)), *((x, 0.7) for x in (0.08, 0.25, 0.4, 0.55))
PLACES |= {other: (x, y, 0.12) for other, (x, y) in zip(OTHERS, MIDDLES, strict=True)}
TURNED_RAD = 0.08
WOBBLE = 16  # frames from one end to the other
NOISE, DARK = 0.005, 0.02
WATCHDOG_S = 10.0  # of the unit
LEAST_SHARE, MOST_PERIODS, SECOND_WITHIN_S, FED_EACH_S = 0.9, 1.5, 1.0, 2.0


def room(drawing: Drawing, rng: Rng) -> None:
    """Ten more panels that can be read."""
    _, height, width = drawing.light.shape
    for other in OTHERS:
        put_panel(drawing, corners(width, height, other), drawing.codewords[other])


SCENES: tuple[Callable[[Drawing, Rng], None], ...] = (packed, window, keyboard, squares, matrix, text, noise, room)


class Scenery:
    """The camera's view, frame by frame; the second panel from `comes` on."""

    def __init__(self, camera: CameraInfo, panels: PanelSettings, draw: Callable[[Drawing], None], comes: int) -> None:
        self._camera, self._comes = camera, comes
        self._blink = Blink(panels.spec(), camera, off=1.0, phases=np.array([0.2, 0.7]))
        assert camera.frame_length_rows is not None
        self.period_ns = round(camera.frame_length_rows * camera.row_time_us * 1e3)
        drawing = Drawing(camera.width, camera.height, panels.dictionary)
        draw(drawing)
        put_panel(drawing, corners(camera.width, camera.height, FIRST), drawing.codewords[FIRST])
        self._light = [drawing.light.copy()]
        put_panel(drawing, corners(camera.width, camera.height, SECOND), drawing.codewords[SECOND])
        self._light.append(drawing.light)
        shape = (camera.height, camera.width)
        self._noise = NOISE * np.random.default_rng(2).standard_normal(shape, np.float32) + np.float32(DARK)

    def frame(self, seq: int) -> Frame:
        at_ns = seq * self.period_ns
        shift = abs(seq % (2 * WOBBLE) - WOBBLE)
        steady, *waves = self._light[seq >= self._comes]
        light: Singles = np.roll(self._noise, 7919 * seq) + np.roll(steady, shift, (0, 1))
        for wave, rows in zip(waves, self._blink.weights(at_ns), strict=True):
            light += np.roll(wave, shift, (0, 1)) * rows[:, None].astype(np.float32)
        return frame_by(self._camera, np.asarray(cv2.convertScaleAbs(np.clip(light, 0, 1), alpha=255)), seq, at_ns)


def corners(width: int, height: int, marker_id: int) -> Floats:
    """(4, 2) of a panel in the picture."""
    x, y, side = PLACES[marker_id]
    half, cos, sin = side * height / 2, np.cos(TURNED_RAD), np.sin(TURNED_RAD)
    square = half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return np.asarray(square @ np.array([[cos, sin], [-sin, cos]]) + (x * width + 0.3, y * height + 0.6))


@dataclass(kw_only=True)
class Run:
    """The results of a scene. Times in ms, from the camera's first frame on."""

    period_ms: float
    took_ms: list[float] = field(default_factory=list)  # of each frame that was decoded
    poses: int = 0  # of the first panel
    second_read: int | None = None  # frames of the camera after it came
    progress_ms: list[float] = field(default_factory=lambda: [0.0])
    ended_ms: float = 0.0

    @property
    def poses_a_second(self) -> float:
        return 1e3 * self.poses / self.ended_ms

    @property
    def longest_periods(self) -> float:
        """But for the first frame, in which nothing is known yet, and no speed measured."""
        return max(self.took_ms[1:]) / self.period_ms

    @property
    def fed_each_s(self) -> float:
        """The longest time between two feeds: one is due, then comes the next progress, and the next look for it."""
        return WATCHDOG_S / FEEDS + TICK_S + max(np.diff(self.progress_ms)) / 1e3


def run(pipeline: Pipeline, scenery: Scenery, *, frames: int, comes: int, slower: float) -> Run:
    """Decodes as the daemon does: the newest frame as soon as the one before is done."""
    period_ms = scenery.period_ns / 1e6
    path, pacing, told = pipeline.likelihood, Pacing(period_ms), Run(period_ms=period_ms)
    free_ms, seq = 0.0, 0
    while seq < frames:
        begins_ms = max(free_ms, (seq + 1) * period_ms)
        frame, spent, started = scenery.frame(seq), path.spent, time.thread_time()

        def at_ms(started: float = started, begins_ms: float = begins_ms) -> float:
            return begins_ms + 1e3 * slower * (time.thread_time() - started)

        def note_progress(_: object, at_ms: Callable[[], float] = at_ms) -> None:
            told.progress_ms.append(at_ms())

        decoded = pipeline.decode(frame, on_partial=note_progress)
        free_ms = at_ms()
        told.progress_ms.append(free_ms)
        took_ms = free_ms - begins_ms
        path.search_budget = pacing.budget_after(path.spent - spent, took_ms)
        told.took_ms.append(took_ms)
        note(told, decoded, seq - comes)
        seq = max(seq + 1, int(free_ms / period_ms) - 1)  # the newest whose read-out has ended
    told.ended_ms = max(free_ms, frames * period_ms)
    return told


def note(told: Run, decoded: Decoded, since_second: int) -> None:
    ids = {marker.detection.id for marker in decoded.markers if marker.solution is not None}
    told.poses += FIRST in ids
    if SECOND in ids and told.second_read is None:
        told.second_read = since_second


def camera_of(size: tuple[int, int], exposure_us: float, panels: PanelSettings) -> CameraInfo:
    row_time_us, least_rows = SENSORS[size]
    return CameraInfo(
        width=size[0],
        height=size[1],
        exposure_us=exposure_us,
        row_time_us=row_time_us,
        transfer="linear",
        frame_length_rows=choose_frame_length_rows(
            shortest_rows=least_rows, row_time_us=row_time_us, frequencies_hz=panels.frequencies_hz()
        ),
        intrinsics=ov5647_lens(*size),
    )


class Contest:
    """One camera and dictionary: the panel alone, then beside each scene."""

    def __init__(
        self, size: tuple[int, int], exposure_us: float, dictionary: str, arguments: argparse.Namespace
    ) -> None:
        self.panels = PanelSettings(side_m=0.16, dictionary=f"DICT_{dictionary}", ids=tuple(PLACES))
        self.camera = camera_of(size, exposure_us, self.panels)
        self.name = f"{size[0]}x{size[1]}/{exposure_us:g}/{dictionary}"
        self._arguments = arguments
        self._alone: Run | None = None

    def run(self, draw: Callable[[Drawing], None]) -> Run:
        period_s = (self.camera.frame_length_rows or 0) * self.camera.row_time_us * 1e-6
        frames = round(self._arguments.seconds / period_s)
        comes = frames // 2
        pipeline = Pipeline(self.camera, self.panels, intrinsics=self.camera.intrinsics)
        scenery = Scenery(self.camera, self.panels, draw, comes)
        return run(pipeline, scenery, frames=frames, comes=comes, slower=self._arguments.slower)

    def beside(self, scene: Callable[[Drawing, Rng], None]) -> tuple[str, list[str]]:
        """A line, and the aims that are missed."""
        self._alone = self._alone or self.run(lambda drawing: None)
        told = self.run(lambda drawing: scene(drawing, np.random.default_rng(self._arguments.draw)))
        share = told.poses_a_second / self._alone.poses_a_second
        second = "never" if told.second_read is None else f"{told.second_read:3} frames"
        missed = {
            "share": share < LEAST_SHARE,
            "first frame": told.took_ms[0] > MOST_PERIODS * told.period_ms,
            "longest": told.longest_periods > MOST_PERIODS,
            "second": told.second_read is None or told.second_read * told.period_ms > 1e3 * SECOND_WITHIN_S,
            "watchdog": told.fed_each_s > FED_EACH_S,
        }
        line = (
            f"{told.poses_a_second:4.1f} poses/s, {100 * share:3.0f} % of {self._alone.poses_a_second:4.1f}; "
            f"periods of {told.period_ms:4.1f} ms: first {told.took_ms[0] / told.period_ms:4.1f}, longest "
            f"{told.longest_periods:4.1f}; second panel {second}; watchdog {told.fed_each_s:3.1f} s"
        )
        return line, [aim for aim, is_missed in missed.items() if is_missed]


def contests(arguments: argparse.Namespace) -> Iterator[tuple[str, Contest, Callable[[Drawing, Rng], None]]]:
    for size in SENSORS:
        for exposure_us in EXPOSURES_US:
            for dictionary in DICTIONARIES:
                contest = Contest(size, exposure_us, dictionary, arguments)
                for scene in SCENES:
                    name = f"{contest.name}/{scene.__name__}"
                    if arguments.only in name:
                        yield name, contest, scene


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seconds", type=float, default=3.0, help="of each scene, as the camera sees it")
    parser.add_argument("--slower", type=float, default=1.0, help="than this machine: about 5 for a Raspberry Pi 4")
    parser.add_argument("--only", default="", help="scenes whose name holds this")
    parser.add_argument("--draw", type=int, default=0, help="another one, for other pictures")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    failed = 0
    for name, contest, scene in contests(arguments):
        line, missed = contest.beside(scene)
        failed += bool(missed)
        print(f"{name:32} {line}{'  MISSED: ' + ', '.join(missed) if missed else ''}", flush=True)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
