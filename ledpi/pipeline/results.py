"""Results of one frame so far: poses, the fix, what was dropped, and how long it took."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from ledpi.core.records import BodyPose, Decoded, Detection, Floats, Frame, MarkerPose, Rejected, RobotFix
from ledpi.pipeline.trace import Dropped, Trace
from ledpi.pose.place import Placer

SAME_PLACE = Rejected(stage="suppression", reason="same_panel")
SAME_ID = Rejected(stage="suppression", reason="same_id")


@dataclass(slots=True)
class Results:
    """Filled in along the path."""

    seconds: dict[str, float]  # by stage
    trace: Trace | None
    rejected: list[Rejected] = field(default_factory=list)
    detections: list[Detection] = field(default_factory=list)  # all, as what was suppressed still speaks against others
    suppressed: list[Detection] = field(default_factory=list)
    markers: list[MarkerPose] = field(default_factory=list)
    fix: RobotFix | Rejected | None = None
    bodies: list[BodyPose | Rejected] = field(default_factory=list)

    def add_time(self, stage: str, since_s: float) -> None:
        """Adds what a stage has taken since then (`time.perf_counter`)."""
        self.seconds[stage] += time.perf_counter() - since_s

    def reject(self, corners_px: Floats, why: Rejected, marker_id: int | None = None) -> None:
        """Counts something four-sided that was no panel, or was read (as `marker_id`) and is not reported."""
        self.rejected.append(why)
        if self.trace is not None:
            self.trace.dropped.append(Dropped(corners_px=corners_px, why=why, marker_id=marker_id))

    def add(self, frame: Frame, detections: list[Detection], placer: Placer) -> list[MarkerPose]:
        """Places the new detections, and the robot by all there are. Returns the new markers.

        Earlier detections are dropped if they and the new ones cannot both be true.
        """
        self.detections += detections
        known = {id(detection) for detection in self.suppressed}
        dropped = [(d, why) for d, why in suppress_duplicates(self.detections) if id(d) not in known]
        for detection, why in dropped:
            self.suppressed.append(detection)
            self.reject(detection.corners_px, why, detection.id)
        gone = {id(detection) for detection in self.suppressed}
        new = [detection for detection in detections if id(detection) not in gone]
        markers = []
        for detection, placed in zip(new, placer.place(frame, new), strict=True):
            if isinstance(placed, Rejected):
                self.reject(detection.corners_px, placed, detection.id)
            else:
                markers.append(placed)
        self.markers = [m for m in self.markers if id(m.detection) not in gone] + markers
        if markers or dropped:
            self.fix = placer.fix(frame, self.markers)
            self.bodies = placer.bodies(frame, self.markers)
        return markers

    def partial_result(self, frame: Frame, markers: Sequence[MarkerPose]) -> Decoded:
        """These markers, and the fix and the bodies as they are now."""
        return self._decoded(frame, markers, ())

    def final_result(self, frame: Frame) -> Decoded:
        """All of it, the most certain marker first."""
        rejected = [*self.rejected, *(one for one in (self.fix, *self.bodies) if isinstance(one, Rejected))]
        return self._decoded(frame, sorted(self.markers, key=lambda m: -m.detection.margin), rejected)

    def _decoded(self, frame: Frame, markers: Sequence[MarkerPose], rejected: Sequence[Rejected]) -> Decoded:
        return Decoded(
            seq=frame.seq,
            row0_readout_ns=frame.row0_readout_ns,
            host_offset_ns=frame.host_offset_ns,
            markers=tuple(markers),
            robot=self.fix if isinstance(self.fix, RobotFix) else None,
            rejected=tuple(rejected),
            bodies=tuple(body for body in self.bodies if isinstance(body, BodyPose)),
            stage_ms={stage: 1e3 * seconds for stage, seconds in self.seconds.items()},
        )


def suppress_duplicates(detections: Iterable[Detection]) -> list[tuple[Detection, Rejected]]:
    """Suppresses what is not the best detection of its panel, and an ID that is in several places: in all of them."""
    kept: list[Detection] = []
    dropped: list[tuple[Detection, Rejected]] = []
    for detection in sorted(detections, key=lambda s: -s.margin):
        middle = detection.corners_px.mean(axis=0)
        if any(cv2.pointPolygonTest(other.corners_px.astype(np.float32), middle, False) > 0 for other in kept):
            dropped.append((detection, SAME_PLACE))
        else:
            kept.append(detection)
    ids = [s.id for s in kept]
    dropped += [(s, SAME_ID) for s in kept if ids.count(s.id) > 1]
    return dropped
