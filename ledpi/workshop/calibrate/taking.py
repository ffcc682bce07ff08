"""Frames to calibrate with, and views of a board, from whatever `camera.source` names."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ledpi.camera.base import AdjustableGain, Camera
from ledpi.camera.factory import open_camera
from ledpi.camera.gain import GainControl, brightest_level
from ledpi.camera.recorded import RecordingCamera, load_recording_with
from ledpi.config.camera_yaml import lens_of
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import Config
from ledpi.core.errors import CalibrationError
from ledpi.core.records import MAX_GAP_NS, CameraInfo, Frame, Intrinsics, Rejected
from ledpi.decode.evidence.cells import SATURATED
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pipeline.trace import Trace
from ledpi.workshop.calibrate.boards import Board, BoardFinder, BoardView, other_board
from ledpi.workshop.calibrate.collecting import Collection, next_exposure

MIN_FRAMES = 20
SETTLE_FRAMES = 300  # five seconds: the gain's sweep takes two


OpenAt = Callable[[tuple[float, float] | None], Camera]  # (exposure µs, gain), or None for the configured ones
MAX_CHANGES = 8  # of the exposure: light that flickers would otherwise keep it changing for ever
BLIND_FRAMES = 15  # without a board, until the exposure is set by the whole picture
NO_BOARD = "show the board to the camera"


@dataclass(frozen=True, slots=True, kw_only=True)
class Taken:
    """One unbroken series of frames, and what its source says of itself."""

    frames: list[Frame]
    camera: CameraInfo
    panels: PanelSettings  # as configured, with the values that a recording brings
    intrinsics: Intrinsics | None
    row_time_ratio: float  # row time and exposure, as they are here, over what the driver reports


def take_frames(config: Config, count: int, advance: Callable[[int], None]) -> Taken:
    """Takes `count` frames, or all that a recording has. Of several takes, the longest one.

    Raises CalibrationError where there are too few, and what the camera itself raises.
    """
    source = config.camera.source
    kind, _, place = source.partition(":")
    camera: Camera
    ratio = 1.0
    if kind == "recording":
        recording = load_recording_with(config, Path(place))
        camera, ratio = RecordingCamera(recording, paced=False), recording.row_time_ratio
    else:
        camera = open_camera(config, paced=kind != "simulated")
    with closing(camera):
        settle_gain(camera, config.panels)
        frames = []
        for frame in _read(camera, count):
            frames.append(frame)
            advance(1)
        intrinsics = lens_of(camera.info, config.camera.intrinsics)
    take = longest_take(frames)
    if len(take) < MIN_FRAMES:
        raise CalibrationError(f"{source}: {len(take)} usable frames in a row; at least {MIN_FRAMES} are needed")
    panels = config.panels if camera.panel is None else config.panels.override_with(camera.panel)
    return Taken(frames=take, camera=camera.info, panels=panels, intrinsics=intrinsics, row_time_ratio=ratio)


def settle_gain(camera: Camera, panels: PanelSettings) -> None:
    """Waits, where the gain is left open, until the brightest lit square is as bright as a panel should be.

    It need not be read as a panel: how it blinks is what is to be found out. Gives up after SETTLE_FRAMES.
    """
    limits = camera.gain_limits if isinstance(camera, AdjustableGain) else None
    if limits is None or not isinstance(camera, AdjustableGain):
        return
    control = GainControl(limits)
    pipeline = Pipeline(camera.info, panels, intrinsics=None, stream=False)
    for frame in _read(camera, SETTLE_FRAMES):
        trace = Trace()
        pipeline.decode(frame, trace)
        squares = [square.quad.corners_px for square in trace.squares]
        squares += [dropped.corners_px for dropped in trace.dropped if dropped.why == SATURATED]
        gain = control.update(frame.row0_readout_ns, frame.analogue_gain, brightest_level(frame, squares))
        if gain is not None:
            camera.set_gain(gain)
        if control.settled:
            return


def _read(camera: Camera, count: int) -> Iterator[Frame]:
    """At most `count` usable frames; ends with the camera's, or when as many were of no use."""
    used = unusable = 0
    while used < count and unusable < count:
        frame = camera.read(np.empty((camera.info.height, camera.info.width), np.uint8))
        if frame is None:
            return
        if isinstance(frame, Rejected):
            unusable += 1
        else:
            used += 1
            yield frame


def longest_take(frames: list[Frame]) -> list[Frame]:
    """The longest run of frames without a gap of more than half a second."""
    takes: list[list[Frame]] = [[]]
    for frame in frames:
        if takes[-1] and frame.row0_readout_ns - takes[-1][-1].row0_readout_ns > MAX_GAP_NS:
            takes.append([])
        takes[-1].append(frame)
    return max(takes, key=len)


def collect_views(
    open_at: OpenAt, board: Board, say: Callable[[str], None], *, metered: bool
) -> tuple[Collection, CameraInfo]:
    """Reads frames until the collection is complete, the camera's frames end, or the user presses Ctrl-C.

    `say` is told what to do whenever that changes. `metered`: the camera is opened anew where the board is too dark or
    too bright. Raises what the camera raises.
    """
    camera = open_at(None)
    collection = Collection(board=board, width=camera.info.width, height=camera.info.height)
    said, blind, changes, other = "", 0, 0, ""
    finder = BoardFinder(board)
    try:
        while (wanted := collection.missing()) is not None:
            text = f"{len(collection.views)} views; {NO_BOARD + other if blind > BLIND_FRAMES else wanted}"
            if text != said:
                say(said := text)
            frame = camera.read(np.empty((collection.height, collection.width), np.uint8))
            if frame is None:
                break
            if isinstance(frame, Rejected):
                continue
            collection.frames += 1
            view = finder.find(f"frame {frame.seq}", frame.pixels)
            if view is not None and collection.board is not finder.board:
                collection.board = finder.board
                say(finder.note(board) or "the board is seen")
            blind = 0 if view is not None else blind + 1
            if blind % BLIND_FRAMES == BLIND_FRAMES - 1:
                other = _seen_instead(frame, board)
            exposure = _other_exposure(frame, view, blind) if metered and changes < MAX_CHANGES else None
            if exposure is not None:
                say(f"exposure {exposure[0]:.0f} µs, gain {exposure[1]:.1f}")
                camera.close()
                camera = open_at(exposure)
                changes += 1
            elif view is not None:
                collection.add(view)
    except KeyboardInterrupt:
        say("ended")
    finally:
        info = camera.info
        camera.close()
    return collection, info


def _seen_instead(frame: Frame, board: Board) -> str:
    """Says what else is in view, for whoever has given another size than the board's."""
    options = other_board(frame.pixels, board)
    return "" if options is None else f"; {options} is seen, not {board.columns} × {board.rows} of a {board.kind}"


def _other_exposure(frame: Frame, view: BoardView | None, blind: int) -> tuple[float, float] | None:
    """A better exposure and gain, by the board, or, where none was seen for a while, by the whole picture."""
    if view is None and blind % BLIND_FRAMES != BLIND_FRAMES - 1:
        return None
    return next_exposure(frame, view)
