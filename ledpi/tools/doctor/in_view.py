"""The panels before the camera: which are read, and why others are not."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from ledpi.camera.base import Camera
from ledpi.config.camera_yaml import lens_of
from ledpi.config.settings import Config
from ledpi.core.errors import CalibrationError
from ledpi.core.records import Floats, Frame, Intrinsics
from ledpi.diagnosis.diagnose import Diagnosis, NotRead, not_read_in
from ledpi.diagnosis.why_not import Why, WhyNot
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pipeline.trace import Trace
from ledpi.tools.doctor.finding import Finding, bad, ok, unknown
from ledpi.tools.snapshot.sources import LOOK_FRAMES, Looking

MOST = 3  # things that are told of


class _Seen(NamedTuple):
    """The frame of several in which most is told."""

    frame: Frame
    not_read: list[NotRead]


def look(camera: Camera, config: Config) -> list[Finding]:
    """Through an open camera, for half a second, and longer where the gain is to be found first.

    A panel that is read in one of the frames is read: what another frame lacks is not told.
    """
    lens = _lens(camera, config)
    looking = Looking(camera, config, lens)
    looking.expose()
    pipeline = Pipeline(camera.info, config.panels, intrinsics=lens, source_panel=camera.panel)
    read_px: dict[int, Floats] = {}  # by ID
    seen: _Seen | None = None
    for frame in itertools.islice(looking.frames(), LOOK_FRAMES):
        trace = Trace()
        for marker in pipeline.decode(frame, trace).markers:
            read_px[marker.detection.id] = marker.detection.corners_px
        told = not_read_in(trace)
        if seen is None or len(told) >= len(seen.not_read):  # the whole picture is searched in some frames only
            kept = replace(frame, pixels=frame.pixels.copy())
            seen = _Seen(kept, told)
    if seen is None:
        return []
    why = WhyNot(camera.info, pipeline.panels, lens).explain(*seen, list(read_px.values()), looking.run)
    return findings_of(sorted(read_px), why)


def _lens(camera: Camera, config: Config) -> Intrinsics | None:
    try:
        return lens_of(camera.info, config.camera.intrinsics)
    except CalibrationError:  # another finding says so
        return None


def findings_of(read: Sequence[int], why: Why) -> list[Finding]:
    """Tells what is read, and of each thing that is not; a light may be no panel."""
    seen = ", ".join(str(marker_id) for marker_id in read)
    findings = [ok("panels", f"ID {seen} read")] if read else []
    findings += [_finding(one) for one in why.diagnoses if one.kind != "shape"][:MOST]
    if not read:  # else it is good enough
        findings += [bad("picture", note.says, note.helps) for note in why.notes]
    return findings or [unknown("panels", "none in view")]


def _finding(one: Diagnosis) -> Finding:
    if one.kind == "panel":
        return bad("panels", one.line, one.helps or "see `ledpi snapshot`")
    return Finding(name="panels", state="unknown", said=one.line, remedy=one.helps)
