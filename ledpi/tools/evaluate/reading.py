"""The methods that read panels, behind one face: a frame in, what was read of it out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from ledpi.config.panels import PanelSettings
from ledpi.core.records import CameraInfo, Decoded, Floats, Frame, PanelValues, Pose
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pipeline.trace import Dropped, Trace

PanelMethod = Literal["uemura", "likelihood", "stream"]
PANEL_METHODS: tuple[PanelMethod, ...] = get_args(PanelMethod)
FRAMES_A_TAKE = 12
# What the tables tell apart. A stream is judged at its 4th and its 12th frame, and on the way.
Row = str
STREAM_ROWS: dict[Row, range] = {
    "stream_4": range(3, 4),
    "stream_12": range(11, 12),
    "stream_all": range(FRAMES_A_TAKE),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """A marker that a method reports."""

    id: int
    corners_px: Floats  # (4, 2) in the marker's order
    pose: Pose | None  # camera_from_marker


@dataclass(frozen=True, slots=True, kw_only=True)
class Read:
    """A method's result on one frame."""

    found: tuple[Found, ...]
    dropped: tuple[Dropped, ...]
    milliseconds: float


class PanelReader:
    """The path of the daemon, from the picture to the pose."""

    def __init__(
        self,
        method: PanelMethod,
        camera: CameraInfo,
        panels: PanelSettings,
        source_panel: PanelValues | None = None,
    ) -> None:
        self._pipeline = Pipeline(
            camera,
            panels,
            intrinsics=camera.intrinsics,
            source_panel=source_panel,
            method="uemura" if method == "uemura" else "likelihood",
            stream=method == "stream",
        )

    def read(self, frame: Frame) -> Read:
        """Returns what is found in the next frame, and how long that took."""
        trace = Trace()
        return read_of(self._pipeline.decode(frame, trace), trace.dropped)


def read_of(decoded: Decoded, dropped: Sequence[Dropped] = ()) -> Read:
    """The result of the daemon's path in the form of any method's."""
    found = tuple(
        Found(
            id=m.detection.id,
            corners_px=m.detection.corners_px,
            pose=m.solution.camera_from_marker if m.solution is not None else None,
        )
        for m in decoded.markers
    )
    return Read(found=found, dropped=tuple(dropped), milliseconds=sum(decoded.stage_ms.values()))
