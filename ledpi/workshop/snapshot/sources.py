"""A frame that shows a panel, of a camera or of the running daemon, and what was made of it."""

from __future__ import annotations

import itertools
import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ledpi.camera.base import Camera, GainFollower
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import Config
from ledpi.core.errors import CameraError, TapError
from ledpi.core.records import CameraInfo, Decoded, Frame, Intrinsics, PanelValues, Rejected, RowsFrom
from ledpi.daemon.tap.client import Client, connect
from ledpi.daemon.tap.frames import camera_of, frame_of
from ledpi.pipeline.diagnosis.diagnose import not_read_in
from ledpi.pipeline.diagnosis.why_not import RUN_FRAMES, Why, WhyNot
from ledpi.pipeline.pipeline import Pipeline, pipeline_of
from ledpi.pipeline.trace import Trace


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """One frame and what was made of it."""

    title: str  # ASCII
    frame: Frame
    decoded: Decoded
    trace: Trace
    panels: PanelSettings
    intrinsics: Intrinsics | None


def take(title: str, frame: Frame, pipeline: Pipeline, intrinsics: Intrinsics | None) -> Snapshot:
    """Decodes a frame, and keeps what it went through."""
    trace = Trace()
    decoded = pipeline.decode(frame, trace)
    return Snapshot(
        title=title, frame=frame, decoded=decoded, trace=trace, panels=pipeline.panels, intrinsics=intrinsics
    )


def explain(snapshot: Snapshot, rows_from: RowsFrom = "above", run: Sequence[Frame] = ()) -> Why:
    """Why panels are not read in it. `run`: frames of its stream about it. Takes a second or two."""
    frame = snapshot.frame
    height, width = frame.pixels.shape
    camera = CameraInfo(
        width=width,
        height=height,
        exposure_us=frame.exposure_us,
        row_time_us=frame.row_time_us,
        transfer=frame.transfer,
        rows_from=rows_from,
    )
    read_px = [marker.detection.corners_px for marker in snapshot.decoded.markers]
    why_not = WhyNot(camera, snapshot.panels, snapshot.intrinsics)
    return why_not.explain(frame, not_read_in(snapshot.trace), read_px, run)


EXPOSE_S = 4.0  # twice what the gain's sweep takes
LOOK_FRAMES = 30  # half a second of a camera
UNUSABLE_FRAMES = 30  # in a row, half a second of a camera, after which it is given up


class Looking:
    """Looks through an open camera; through `lens`, if it is known."""

    def __init__(self, camera: Camera, settings: Config, lens: Intrinsics | None) -> None:
        self._camera, self._settings, self._lens = camera, settings, lens
        self._into = np.empty((camera.info.height, camera.info.width), np.uint8)
        self.run: deque[Frame] = deque(maxlen=RUN_FRAMES)  # the last of `frames`, each in a place of its own

    def expose(self) -> None:
        """Looks for the panels with every gain, where the gain is `auto`, for EXPOSE_S at most."""
        follower = GainFollower(self._camera)
        if follower.settled:
            return
        pipeline = self._pipeline(stream=True)
        end_s = time.monotonic() + EXPOSE_S
        while not follower.settled and time.monotonic() < end_s:
            frame = self._camera.read(self._into)
            if frame is None:
                return
            if isinstance(frame, Frame):
                follower.update(frame, pipeline.decode(frame))

    def frames(self) -> Iterator[Frame]:
        """Frame by frame, each in the place of the one before, until the camera's end. Raises CameraError."""
        unusable = 0
        while (frame := self._camera.read(self._into)) is not None:
            if not isinstance(frame, Rejected):
                unusable = 0
                self.run.append(replace(frame, pixels=frame.pixels.copy()))
                yield frame
                continue
            unusable += 1
            if unusable >= UNUSABLE_FRAMES:
                name = self._settings.camera.source
                raise CameraError(f"camera.source: {name} gave {unusable} unusable frames in a row: {frame.key}")

    def showing_a_panel(self) -> Frame | None:
        """The first that shows a panel by itself; where none of LOOK_FRAMES does, the last, to show why."""
        alone, frame = self._pipeline(stream=False), None
        for frame in itertools.islice(self.frames(), LOOK_FRAMES):
            if alone.decode(frame).markers:
                break
        return frame

    def _pipeline(self, *, stream: bool) -> Pipeline:
        camera, settings = self._camera, self._settings
        method = settings.decode.method if not stream else "likelihood"
        return Pipeline(
            camera.info, settings.panels, intrinsics=self._lens, source_panel=camera.panel, method=method, stream=stream
        )


class Source(NamedTuple):
    """A frame, where it comes from, and what that knows."""

    title: str
    frame: Frame
    camera: CameraInfo
    panel: PanelValues | None
    intrinsics: Intrinsics | None
    pictures: tuple[Path, ...] = ()  # of a recording
    run: tuple[Frame, ...] = ()  # of its stream, about it


def connected(config: Path | None) -> Client | None:
    """To the daemon that runs here; None where none does, or where it has another configuration than `config`."""
    try:
        tap = connect()
    except TapError:
        return None
    used = tap.hello.get("config_path")
    if config is None or (used is not None and Path(used) == config.absolute()):
        return tap
    tap.close()
    return None


def showing_a_panel(tap: Client, settings: Config) -> Source:
    """The first of LOOK_FRAMES that shows a panel by itself; else the last, to show why. Raises TapError."""
    camera = camera_of(tap.hello)
    alone = pipeline_of(settings, camera, camera.intrinsics, stream=False)
    run: deque[Frame] = deque(maxlen=RUN_FRAMES)
    for _ in range(LOOK_FRAMES):
        frame = frame_of(tap.hello, tap.picture())
        run.append(frame)
        if alone.decode(frame).markers:
            break
    title = f"running daemon (pid {tap.hello.get('pid')}), frame {frame.seq}"
    return Source(title, frame, camera, None, camera.intrinsics, run=tuple(run))
