"""Readings of a frame by each method, scored against what is there: counts and errors that add up."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Literal, get_args

import numpy as np
from typing_extensions import Self

from ledpi.camera.recording.reader import TruthMarker
from ledpi.config.panels import PanelSettings
from ledpi.core.geometry import quad_side, rotation_angle_deg
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

# A marker is recognised where its ID is right and each corner is within this share of its size in the picture: then it
# is that marker, and turned the right way. How exactly it is placed is told by the errors.
PLACE_SHARE = 0.25
NOTHING_THERE = "find.nothing_there"  # nothing four-sided was found where a missed panel is


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
        self, method: PanelMethod, camera: CameraInfo, panels: PanelSettings, source_panel: PanelValues | None = None
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Expected:
    """A marker that is in view. Of real frames often no more is known than its ID."""

    id: int
    corners_px: Floats | None = None  # (4, 2)
    pose: Pose | None = None
    optional: bool = False  # only partly in view: may be read or not

    @classmethod
    def from_truth(cls, truth: TruthMarker) -> Self:
        """Returns what a recording's truth, or the simulator's, says of one panel."""
        return cls(id=truth.id, corners_px=truth.corners_px, pose=truth.camera_from_marker, optional=truth.optional)

    def matches(self, found: Found) -> bool:
        """Tells whether this is what was found."""
        if found.id != self.id or self.corners_px is None:
            return found.id == self.id
        off = np.hypot(*(found.corners_px - self.corners_px).T)
        return bool(off.max() <= PLACE_SHARE * quad_side(self.corners_px.tolist()))


@dataclass(slots=True, kw_only=True)
class Tally:
    """Counts and errors of one method under one condition. The errors are of what was recognised."""

    frames: int = 0
    trials: int = 0  # that owe nothing to each other: frames of one take are one
    expected: int = 0
    recognised: int = 0
    false_ids: int = 0
    corner_px: list[float] = field(default_factory=list)  # rms over the four corners
    position_percent: list[float] = field(default_factory=list)  # of the distance
    angle_deg: list[float] = field(default_factory=list)
    decode_ms: list[float] = field(default_factory=list)
    missed: Counter[str] = field(default_factory=Counter)  # why, by how many
    false: list[str] = field(default_factory=list)  # each false ID, told so that it can be looked at

    def add(self, read: Read, expected: Sequence[Expected], where: str) -> None:
        """One frame; `where` names it."""
        self.frames += 1
        self.decode_ms.append(round(read.milliseconds, 3))
        left = list(read.found)
        for marker in expected:
            found = next((f for f in left if marker.matches(f)), None)
            if found is not None:
                left.remove(found)
            if marker.optional:
                continue
            self.expected += 1
            if found is None:
                self.missed[_why(marker, read)] += 1
            else:
                self.recognised += 1
                self._add_errors(marker, found)
        self.false_ids += len(left)
        self.false += [f"{where}: {_described(f, expected)}" for f in left]

    def _add_errors(self, marker: Expected, found: Found) -> None:
        if marker.corners_px is not None:
            squares = np.square(found.corners_px - marker.corners_px).sum(axis=1)
            self.corner_px.append(_short(math.sqrt(float(squares.mean()))))
        if marker.pose is not None and found.pose is not None:
            true_m, read_m = marker.pose.position_m, found.pose.position_m
            self.position_percent.append(
                _short(100.0 * float(np.linalg.norm(read_m - true_m) / np.linalg.norm(true_m)))
            )
            self.angle_deg.append(_short(rotation_angle_deg(found.pose.quaternion_wxyz, marker.pose.quaternion_wxyz)))

    def as_json(self) -> dict[str, Any]:
        """All of it, in what JSON can hold; `from_json` takes it back."""
        return {f.name: getattr(self, f.name) for f in fields(self)} | {"missed": dict(sorted(self.missed.items()))}

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Self:
        """A tally from what `as_json` gave."""
        return cls(**values | {"missed": Counter(values["missed"])})

    @classmethod
    def sum_of(cls, tallies: Iterable[Tally]) -> Self:
        """One tally of all their frames, errors in the order given."""
        total = cls()
        for tally in tallies:
            for name in ("frames", "trials", "expected", "recognised", "false_ids"):
                setattr(total, name, getattr(total, name) + getattr(tally, name))
            for name in ("corner_px", "position_percent", "angle_deg", "decode_ms", "false"):
                getattr(total, name).extend(getattr(tally, name))
            total.missed += tally.missed
        return total


def _why(marker: Expected, read: Read) -> str:
    """Why a marker was missed: what became of the candidate that was most nearly at its place."""
    if marker.corners_px is None:
        return read.dropped[0].why.key if len(read.dropped) == 1 else "not told"
    near = [
        (float(np.hypot(*(drop.corners_px.mean(axis=0) - marker.corners_px.mean(axis=0)))), drop.why.key)
        for drop in read.dropped
    ]
    away, why = min(near, default=(math.inf, ""))
    return why if away <= PLACE_SHARE * quad_side(marker.corners_px.tolist()) else NOTHING_THERE


def _described(found: Found, expected: Sequence[Expected]) -> str:
    """A false ID: which, where, and what is there."""
    middle, size_px = found.corners_px.mean(axis=0), quad_side(found.corners_px.tolist())
    text = f"ID {found.id} at ({middle[0]:.0f}, {middle[1]:.0f}) px, {size_px:.0f} px large"
    for marker in expected:
        if marker.corners_px is not None:
            away = float(np.hypot(*(middle - marker.corners_px.mean(axis=0))))
            if away <= quad_side(marker.corners_px.tolist()):
                off = float(np.hypot(*(found.corners_px - marker.corners_px).T).max())
                return f"{text}, where {marker.id} is, a corner off by {off:.0f} px"
    return text


def _short(value: float) -> float:
    return float(f"{value:.5g}")
