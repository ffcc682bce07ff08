"""The record of a drawing: one frame, and what was made of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ledpi.config.panels import PanelSettings
from ledpi.core.codewords import Bits
from ledpi.core.records import CameraInfo, Decoded, Frame, Intrinsics, RowsFrom
from ledpi.pipeline.diagnosis.diagnose import not_read_in
from ledpi.pipeline.diagnosis.why_not import Why, WhyNot
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pipeline.trace import Dropped, Trace


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """One frame and what was made of it."""

    title: str  # ASCII
    frame: Frame
    decoded: Decoded
    trace: Trace
    panels: PanelSettings
    intrinsics: Intrinsics | None

    @property
    def dropped(self) -> list[Dropped]:
        """Lists what was four-sided and no panel."""
        return self.trace.dropped

    def codeword(self, marker_id: int) -> Bits:
        """The cells of an ID, upright."""
        return self.panels.words.codeword(marker_id)


def take(title: str, frame: Frame, pipeline: Pipeline, intrinsics: Intrinsics | None) -> Snapshot:
    """Decodes a frame, and keeps what it went through."""
    trace = Trace()
    decoded = pipeline.decode(frame, trace)
    return Snapshot(
        title=title,
        frame=frame,
        decoded=decoded,
        trace=trace,
        panels=pipeline.panels,
        intrinsics=intrinsics,
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
