"""The path of one frame: a method reads its panels, and each that exists gets a pose."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from ledpi.config.bodies import body_maps
from ledpi.config.check import load_own_map
from ledpi.config.panels import PanelSettings
from ledpi.config.robot import base_link_from_camera
from ledpi.config.settings import Config, Method
from ledpi.core.codewords import Dictionary
from ledpi.core.records import (
    MAX_GAP_NS,
    CameraInfo,
    Decoded,
    Detection,
    Frame,
    Intrinsics,
    PanelSpec,
    PanelValues,
    Pixels,
    Rejected,
)
from ledpi.core.shutter import MIN_DEVIATION, RowClock
from ledpi.decode.uemura import NO_SQUARE, UemuraReader
from ledpi.pipeline.likelihood import Groups, LikelihoodPath
from ledpi.pipeline.results import Results
from ledpi.pipeline.trace import Trace
from ledpi.pose.fix import Robot
from ledpi.pose.place import Placer

STAGES: dict[Method, tuple[str, ...]] = {
    "likelihood": ("find", "fit", "cells", "identify", "pose"),
    "uemura": ("uemura", "pose"),
}
REPEATED = Rejected(stage="capture", reason="repeated")
# Every fourth row is compared: a panel that can be read crosses two of them at least, and noise never gives the same
# pixels again. Where nothing is lit pictures may be alike, and nothing is lost.
ROW_STEP = 4
BUFFERS = 8  # a driver that hangs gives the pictures in its buffers by turns: V4L2 and libcamera ask for four to six


class UemuraPath:
    """Reads panels as the source paper does, once for each pair of frequencies: each frame is alone."""

    def __init__(self, dictionary: Dictionary, groups: Groups) -> None:
        self._readers = [UemuraReader(dictionary, ids, spec) for spec, ids in groups]

    def read(self, frame: Frame, work: Results) -> Iterator[list[Detection]]:
        """All panels of the frame at once."""
        start = time.perf_counter()
        detections = []
        for reader in self._readers:
            steps = reader.read(frame)
            if work.trace is not None:
                work.trace.uemura.append(steps)
                work.trace.searched = True
            if not steps.squares:
                work.rejected.append(NO_SQUARE)
            for square in steps.squares:
                if isinstance(square.result, Rejected):
                    work.reject(square.corners_px, square.result)
                else:
                    detections.append(square.result)
        work.add_time("uemura", start)
        yield detections


class Repeats:
    """Tells whether a stream's picture is one of the last ones, byte for byte, which a camera gives with a new time.

    What is old is never taken for what is seen now.
    """

    def __init__(self) -> None:
        self._past: deque[Pixels] = deque()  # the oldest first
        self._last_ns = 0

    def is_repeated(self, frame: Frame) -> bool:
        """Compares the picture with those that were kept, after a gap with the last one only; keeps its rows, too."""
        rows, now_ns = frame.pixels[::ROW_STEP], frame.row0_readout_ns
        if self._past and rows.shape != self._past[-1].shape:
            self._past.clear()
        if not 0 < now_ns - self._last_ns <= MAX_GAP_NS:
            self._past = deque([*self._past][-1:])
        self._last_ns = now_ns
        middle = len(rows) // 2  # which differs, as a rule, so that no more need be compared
        if any(np.array_equal(rows[middle], past[middle]) and np.array_equal(rows, past) for past in self._past):
            return True
        room = self._past.popleft() if len(self._past) == BUFFERS else np.empty(rows.shape, np.uint8)
        np.copyto(room, rows)
        self._past.append(room)
        return False


NOT_EXISTING = Rejected(stage="identify", reason="id_not_in_panels_ids")  # or a part or reflection of a panel


class Pipeline:
    """Decodes the frames of one camera. Not shared between threads.

    `stream`: frames follow each other in time, and tracks add to what a frame shows; else each frame is alone, as it
    always is for the method `uemura`. `source_panel`: what a recording says of its own panels, which overrides
    `panels`. `robot`: how the camera sits on it, and its map; without, no fix is solved. Raises ConfigError where
    `panels` contradict what is shown.
    """

    def __init__(
        self,
        camera: CameraInfo,
        panels: PanelSettings,
        *,
        intrinsics: Intrinsics | None,
        source_panel: PanelValues | None = None,
        robot: Robot | None = None,
        method: Method = "likelihood",
        stream: bool = True,
    ) -> None:
        """`panels` as the attribute then are those that are searched for."""
        self.panels = panels = panels if source_panel is None else panels.override_with(source_panel)
        self._method: Method = method
        self._stream = stream
        dictionary, groups = panels.words, _same_frequencies(panels)
        self.cells, self.specs = dictionary.cells_per_side, tuple(spec for spec, _ in groups)
        self._existing = panels.existing_ids()
        sides_m = {marker_id: panels.spec(marker_id).side_m for marker_id in range(len(dictionary.codewords))}
        self._placer = Placer(intrinsics, sides_m, stream=stream, robot=robot)
        self._row_clock = RowClock(camera)
        self._repeats = Repeats()
        self._rows_from = camera.rows_from
        self.likelihood = LikelihoodPath(camera, panels, groups, intrinsics, stream=stream)
        self._read = self.likelihood.read if method == "likelihood" else UemuraPath(dictionary, groups).read

    def decode(
        self, frame: Frame, trace: Trace | None = None, on_partial: Callable[[Decoded], None] = lambda partial: None
    ) -> Decoded:
        """Everything that this frame shows. Time in `stage_ms` is from the picture in memory to the pose.

        `on_partial` gets the same piece by piece, each as soon as it is known: tracked panels need not wait until the
        picture has been searched for others. If further panels change the fix, it is sent again. `trace` records what
        each step made of the frame, and each candidate that was dropped; what `find` itself drops has no corners yet,
        and is only counted.
        """
        read_out_ns = frame.row0_readout_ns
        frame = self._correct_row_time(frame)
        if self._rows_from == "below":
            frame = frame.turned()
        work = Results(dict.fromkeys(STAGES[self._method], 0.0), trace)
        if self._stream and self._repeats.is_repeated(frame):
            work.rejected.append(REPEATED)
            return replace(work.final_result(frame), row0_readout_ns=read_out_ns)
        for read in self._read(frame, work):
            detections = [detection for detection in read if self._exists(detection, work)]
            if detections:
                start = time.perf_counter()
                markers = work.add(frame, detections, self._placer)
                work.add_time("pose", start)
                on_partial(replace(work.partial_result(frame, markers), row0_readout_ns=read_out_ns))
        return replace(work.final_result(frame), row0_readout_ns=read_out_ns)

    def _exists(self, detection: Detection, work: Results) -> bool:
        """Tells whether there is a panel of this ID."""
        exists = detection.id in self._existing
        if not exists:
            work.reject(detection.corners_px, NOT_EXISTING, detection.id)
        return exists

    def _correct_row_time(self, frame: Frame) -> Frame:
        """The frame, corrected where the stream's own times say that the driver misreports its row time."""
        if not self._stream:
            return frame
        before = self._row_clock.ratio
        self._row_clock.add(frame.seq, frame.row0_readout_ns)
        if abs(self._row_clock.ratio - before) > MIN_DEVIATION:  # what was seen so far was seen in the wrong bands
            self.likelihood.forget()
        return self._row_clock.corrected(frame)


def _same_frequencies(panels: PanelSettings) -> list[tuple[PanelSpec, list[int]]]:
    """The panel and the IDs of each set of frequencies and duty that there is."""
    groups: dict[tuple[tuple[float, ...], float], tuple[PanelSpec, list[int]]] = {}
    for marker_id in range(len(panels.words.codewords)):
        spec = panels.spec(marker_id)
        groups.setdefault((spec.waves_hz, spec.duty), (spec, []))[1].append(marker_id)
    return list(groups.values())


def pipeline_of(
    config: Config,
    camera: CameraInfo,
    lens: Intrinsics | None,
    source_panel: PanelValues | None = None,
    *,
    robot: Robot | None = None,
    stream: bool = True,
) -> Pipeline:
    """Makes one that has seen nothing. `robot`: where it is loaded already. Raises LedpiError."""
    return Pipeline(
        camera,
        config.panels,
        intrinsics=lens,
        source_panel=source_panel,
        robot=load_robot(config) if robot is None else robot,
        method=config.decode.method,
        stream=stream,
    )


def load_robot(config: Config) -> Robot:
    """Reads the map too, if there is one. Raises ConfigError."""
    return Robot(
        base_link_from_camera=base_link_from_camera(config.robot.camera_mount),
        panels=load_own_map(config),
        panels_upright=config.panels.upright,
        bodies=body_maps(config.bodies),
    )
