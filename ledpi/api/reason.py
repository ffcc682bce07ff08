"""Why something in a picture is not reported, as a program uses it."""

from __future__ import annotations

from dataclasses import dataclass

from ledpi.core.records import CameraInfo, Floats, Frame, Intrinsics
from ledpi.diagnosis.diagnose import not_read_in
from ledpi.diagnosis.why_not import WhyNot
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pipeline.trace import Trace


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reason:
    """Something that looks like a panel and is not reported, or what the whole picture lacks."""

    says: str  # what is wrong, as in "looks like ID 11 mirrored"
    helps: str  # what helps; "" where nothing is to be done
    is_panel: bool  # whether it surely is a panel, or the picture itself; else it may be a lamp
    corners_px: Floats | None  # (4, 2) clockwise; None for the whole picture


def reasons_of(frame: Frame, camera: CameraInfo, pipeline: Pipeline, lens: Intrinsics | None) -> list[Reason]:
    """Decodes the frame once more, and under other assumptions. Takes a second or two."""
    trace = Trace()
    read_px = [marker.detection.corners_px for marker in pipeline.decode(frame, trace).markers]
    why = WhyNot(camera, pipeline.panels, lens).explain(frame, not_read_in(trace), read_px)
    found = [
        Reason(says=one.says, helps=one.helps, is_panel=one.kind == "panel", corners_px=one.corners_px)
        for one in why.diagnoses
        if one.kind != "shape"
    ]
    return found + [Reason(says=note.says, helps=note.helps, is_panel=True, corners_px=None) for note in why.notes]
