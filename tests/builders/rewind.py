"""A stream of simulated frames, decoded live, with what the pipeline remembered before some of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from ledpi.camera.simulated import SimulatedCamera, open_simulated
from ledpi.config.settings import Config, load_config
from ledpi.core.geometry import matrix_from_quaternion, transform
from ledpi.core.records import CameraInfo, Decoded, Frame, MarkerPose
from ledpi.pipeline.output import decoded_as_json
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pipeline.state import PipelineState
from ledpi.pose.fix import Robot
from ledpi.pose.panel_map import MapPanel
from tests.builders.daemon import SIMULATED

EVERY = 15  # frames, between two states
HEIGHT, WIDTH = 480, 640  # of numbered frames
DRIVE = (240, 320)  # height and width of the simulated drive
PERIOD_NS = 20_000_000  # of numbered frames


@dataclass(frozen=True)
class Stream:
    """Frames that follow each other, and what a pipeline has made of them."""

    config: Config
    camera: CameraInfo
    robot: Robot | None
    frames: list[Frame]
    live: list[Decoded]
    states: dict[int, PipelineState]  # before the frame of that index

    def pipeline(self) -> Pipeline:
        """Another one, which has seen nothing."""
        return Pipeline(self.camera, self.config.panels, intrinsics=self.camera.intrinsics, robot=self.robot)


def stream(count: int, *settings: str, robot: Robot | None = None) -> Stream:
    """The simulated drive."""
    camera, frames = _drive(settings)
    while len(frames) < count and isinstance(frame := camera.read(np.empty(DRIVE, np.uint8)), Frame):
        frames.append(frame)
    return decoded_live(load_config(None, (*SIMULATED, *settings)), camera.info, frames[:count], robot)


@cache
def _drive(settings: tuple[str, ...]) -> tuple[SimulatedCamera, list[Frame]]:
    """With as much of it as has been drawn so far, for all tests of this process."""
    return open_simulated(load_config(None, (*SIMULATED, *settings)), paced=False), []


def decoded_live(config: Config, info: CameraInfo, frames: list[Frame], robot: Robot | None = None) -> Stream:
    """These frames, one after the other."""
    made = Stream(config, info, robot, frames, [], {})
    pipeline = made.pipeline()
    for index, frame in enumerate(frames):
        if index % EVERY == 0:
            made.states[index] = pipeline.state()
        made.live.append(pipeline.decode(frame))
    return made


def robot_in(decoded: Decoded) -> Robot:
    """A robot that is its camera, and a map in which it stood at the origin when it decoded this."""
    places = {marker.detection.id: MapPanel(map_from_marker=_place(marker)) for marker in decoded.markers}
    return Robot(base_link_from_camera=np.eye(4), panels=places)


def _place(marker: MarkerPose) -> Any:
    assert marker.solution is not None
    pose = marker.solution.camera_from_marker
    return transform(matrix_from_quaternion(pose.quaternion_wxyz), pose.position_m)


def exactly(decoded: Decoded) -> tuple[Any, ...]:
    """All of it to the last bit, but for times."""
    numbers: list[Any] = []
    for marker in decoded.markers:
        numbers += [marker.detection.id, marker.detection.margin, marker.detection.corners_px.tobytes()]
        for solution in (marker.solution, marker.alternate):
            if solution is not None:
                pose = solution.camera_from_marker
                parts = (pose.position_m, pose.quaternion_wxyz, pose.covariance)
                numbers += [part.tobytes() for part in parts if part is not None]
    if decoded.robot is not None:
        numbers.append(decoded.robot.map_from_base_link.position_m.tobytes())
    return (*numbers, *(why.key for why in decoded.rejected), decoded.seq)


def without_times(lines: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Lines of `ledpi decode`, but for how long it took and what the recording is called."""
    return [{key: value for key, value in line.items() if key not in ("decode_ms", "recording")} for line in lines]


def as_lines(decoded: Sequence[Decoded]) -> list[dict[str, Any]]:
    """What `ledpi decode` prints of them, but for times."""
    return without_times([decoded_as_json(each, "") for each in decoded])


def later(frame: Frame, ns: int, seq: int = 0) -> Frame:
    """The same picture at another time."""
    return replace(frame, seq=frame.seq + seq, row0_readout_ns=frame.row0_readout_ns + ns)


def numbered(seq: int) -> Frame:
    """A frame all of whose pixels are its number."""
    pixels = np.full((HEIGHT, WIDTH), seq % 256, np.uint8)
    at_ns = 1_000_000_000 + seq * PERIOD_NS
    return Frame(pixels=pixels, seq=seq, row0_readout_ns=at_ns, exposure_us=1e4, row_time_us=33.67, transfer="linear")


def nothing_in(frame: Frame) -> Decoded:
    return Decoded(
        seq=frame.seq,
        row0_readout_ns=frame.row0_readout_ns,
        host_offset_ns=0,
        markers=(),
        robot=None,
        rejected=(),
        stage_ms={"find": 1.0},
    )
