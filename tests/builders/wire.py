"""Parts of the wire's tests: the vectors of docs/wire.md, and decoded frames of a known age."""

from __future__ import annotations

import json
import re
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from ledpi.core.records import Decoded, Detection, Floats, MarkerPose, PlanarSolution, Pose, RobotFix
from ledpi.wire import (
    FixMessage,
    MarkerMessage,
    Message,
    Mode,
    NoFix,
    OdometryMessage,
    State,
    StateMessage,
    StatusMessage,
    TimeAnswer,
    TimeAsk,
    WirePose,
)
from ledpi.wire.codec import FROM_CONTROLLER, FROM_LEDPI
from ledpi.wire.outbox import PublisherCounters
from tests.builders import ROOT

PAGE = ROOT / "docs" / "wire.md"


@dataclass(frozen=True, slots=True)
class Vector:
    name: str
    frame: bytes  # delimiter included
    sequence: int
    values: dict[str, Any]  # as `ledpi monitor --json`
    kinds: tuple[type[Message], ...]  # of its direction


@dataclass(frozen=True, slots=True)
class RejectedVector:
    name: str
    frame: bytes
    reason: str


def _entries(block: str) -> list[dict[str, str]]:
    found = re.search(rf"```{block}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert found, f"docs/wire.md has no block {block}"
    entries = found[1].strip().split("\n\n")
    return [dict(re.findall(r"^(\w+): (.*(?:\n +.*)*)$", entry, re.MULTILINE)) for entry in entries]


def vectors(block: str = "vectors", kinds: tuple[type[Message], ...] = FROM_LEDPI) -> list[Vector]:
    return [
        Vector(e["name"], bytes.fromhex(e["bytes"]), int(e["sequence"]), json.loads(e["json"]), kinds)
        for e in _entries(block)
    ]


def controller_vectors() -> list[Vector]:
    return vectors("controller", FROM_CONTROLLER)


def rejected_vectors() -> list[RejectedVector]:
    return [RejectedVector(e["name"], bytes.fromhex(e["bytes"]), e["reason"]) for e in _entries("rejected")]


def message_of(values: dict[str, Any]) -> Message:
    """The record that the page's JSON describes."""
    v: dict[str, Any] = {k: tuple(value) if isinstance(value, list) else value for k, value in values.items()}
    kind = v.pop("message")
    if kind == "status":
        return StatusMessage(**v | {"state": State[v["state"].upper()], "no_fix": NoFix[v["no_fix"].upper()]})
    if kind == "state":
        return StateMessage(**v | {"mode": Mode[v["mode"].upper()]})
    for record in (OdometryMessage, TimeAsk, TimeAnswer):
        if kind == record.name:
            return record(**v)
    pose_keys = ("position_m", "quaternion_wxyz", "deviation_m", "deviation_rad")
    pose_values = {key: v.pop(key) for key in pose_keys}
    pose = None if pose_values["position_m"] is None else WirePose(**pose_values)
    if kind == "marker":
        return MarkerMessage(pose=pose, **v)
    assert pose is not None
    return FixMessage(pose=pose, **v)


def pose_at(x: float, covariance: Floats | None = None) -> Pose:
    turned = np.array([0.0, 1.0, 0.0, 0.0])
    return Pose(position_m=np.array([x, 0.0, 1.0]), quaternion_wxyz=turned, covariance=covariance)


def marker_pose(
    marker_id: int, mid_exposure_ns: int, *, pose: Pose | None = None, ambiguous: bool = False
) -> MarkerPose:
    solution = PlanarSolution(camera_from_marker=pose or pose_at(0.0), reprojection_px=0.1, chi2=1.0)
    other = PlanarSolution(camera_from_marker=pose_at(-1.0), reprojection_px=0.3, chi2=1.0)
    detection = Detection(
        id=marker_id, corners_px=np.zeros((4, 2)), covariance_px2=0.01 * np.eye(8), margin=10.0, frames_used=1
    )
    return MarkerPose(
        detection=detection,
        mid_exposure_ns=mid_exposure_ns,
        solution=solution,
        alternate=other if ambiguous else None,
    )


def robot_fix(mid_exposure_ns: int, x: float = 0.0, panels_used: tuple[int, ...] = (7,)) -> RobotFix:
    return RobotFix(map_from_base_link=pose_at(x), mid_exposure_ns=mid_exposure_ns, panels_used=panels_used)


def decoded(*markers: MarkerPose, robot: RobotFix | None = None, host_offset_ns: int = 0, seq: int = 0) -> Decoded:
    return Decoded(
        seq=seq,
        row0_readout_ns=0,
        host_offset_ns=host_offset_ns,
        markers=markers,
        robot=robot,
        rejected=(),
        stage_ms={},
    )


def decoded_now(*marker_ids: int, fix: bool = False, age_ms: float = 1.0) -> Decoded:
    """A frame whose middle was `age_ms` ago."""
    mid_ns = time.monotonic_ns() - round(age_ms * 1e6)
    robot = robot_fix(mid_ns) if fix else None
    return decoded(*(marker_pose(marker_id, mid_ns) for marker_id in marker_ids), robot=robot)


def publisher_counters(**changed: int) -> PublisherCounters:
    """None of anything, but for these; the port is open."""
    names = ("fixes", "statuses", "markers", "replaced", "stale", "refused", "cut", "opened")
    return PublisherCounters(**(dict.fromkeys(names, 0) | changed), port="/dev/ttyACM0", connected=True, error=None)
