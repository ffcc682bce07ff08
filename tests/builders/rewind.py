"""A stream of simulated frames, decoded live; and whether what was recorded of it is decoded as it was live."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from ledpi.camera.simulated import SimulatedCamera, open_simulated
from ledpi.config.settings import Config, load_config
from ledpi.core.records import CameraInfo, Decoded, Frame
from ledpi.daemon.kept_frames import RUN_IN_NS
from ledpi.daemon.takes import Shown
from ledpi.pipeline.output import decoded_as_json
from ledpi.pipeline.pipeline import Pipeline
from tests.builders.daemon import SIMULATED

HEIGHT, WIDTH = 480, 640  # of numbered frames
DRIVE = (240, 320)  # height and width of the simulated drive
PERIOD_NS = 20_000_000  # of numbered frames


@dataclass(frozen=True)
class Stream:
    """Frames that follow each other, and what a pipeline has made of them."""

    config: Config
    camera: CameraInfo
    frames: list[Frame]
    live: list[Decoded]

    @property
    def shown(self) -> Shown:
        """Words of a recording of it."""
        panels = self.config.panels
        return Shown(self.camera, panels.dictionary, panels.spec(), "simulated")

    def pipeline(self) -> Pipeline:
        """Another one, which has seen nothing."""
        return Pipeline(self.camera, self.config.panels, intrinsics=self.camera.intrinsics)


def stream(count: int, *settings: str) -> Stream:
    """The simulated drive."""
    camera, frames = _drive(settings)
    while len(frames) < count and isinstance(frame := camera.read(np.empty(DRIVE, np.uint8)), Frame):
        frames.append(frame)
    return decoded_live(load_config(None, (*SIMULATED, *settings)), camera.info, frames[:count])


@cache
def _drive(settings: tuple[str, ...]) -> tuple[SimulatedCamera, list[Frame]]:
    """With as much of it as has been drawn so far, for all tests of this process."""
    return open_simulated(load_config(None, (*SIMULATED, *settings)), paced=False), []


def decoded_live(config: Config, info: CameraInfo, frames: list[Frame]) -> Stream:
    """These frames, one after the other."""
    made = Stream(config, info, frames, [])
    pipeline = made.pipeline()
    made.live.extend(map(pipeline.decode, frames))
    return made


def without_times(lines: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Lines of `ledpi decode`, but for how long it took and what the recording is called."""
    return [{key: value for key, value in line.items() if key not in ("decode_ms", "recording")} for line in lines]


def without_exposures(told: dict[str, Any]) -> dict[str, Any]:
    """A line of the tap, but for when each pose was exposed: on the machine's clock, which a recording has not."""
    markers = [{key: value for key, value in one.items() if key != "exposed_ns"} for one in told["markers"]]
    robot = told["robot"] and {key: value for key, value in told["robot"].items() if key != "exposed_ns"}
    return told | {"markers": markers, "robot": robot}


def as_lines(decoded: Sequence[Decoded]) -> list[dict[str, Any]]:
    """Returns what `ledpi decode` prints of them, but for times."""
    return without_times([decoded_as_json(each, "") for each in decoded])


def differences_once_settled(live: Sequence[dict[str, Any]], again: Sequence[dict[str, Any]]) -> list[str]:
    """Names what a decoder that began with these frames says otherwise than live after the first second.

    On a busy machine live searches less, and it takes longer to find the panels again. From then on one frame of twenty
    may have a panel more or less; places agree within three of their deviations.
    """
    assert [line["seq"] for line in again] == [line["seq"] for line in live]
    begin_ns = live[0]["sensor_timestamp_ns"] + RUN_IN_NS
    both = [pair for pair in zip(live, again, strict=True) if pair[0]["sensor_timestamp_ns"] >= begin_ns]
    both = list(itertools.dropwhile(lambda pair: _by_id(pair[0]).keys() != _by_id(pair[1]).keys(), both))
    assert both, "a recording of more than a second"
    other_ids = [f"frame {one['seq']}: other IDs" for one, other in both if _by_id(one).keys() != _by_id(other).keys()]
    moved = [
        f"frame {one['seq']}: ID {marker_id} is elsewhere"
        for one, other in both
        for marker_id in _by_id(one).keys() & _by_id(other).keys()
        if _deviations(_by_id(one)[marker_id], _by_id(other)[marker_id]) > 3.0
    ]
    return moved + (other_ids if len(other_ids) > len(both) / 20 else [])


def _by_id(line: dict[str, Any]) -> dict[int, dict[str, Any]]:
    return {marker["id"]: marker for marker in line["markers"]}


def _deviations(marker: dict[str, Any], other: dict[str, Any]) -> float:
    off = np.abs(np.subtract(marker["position_m"], other["position_m"]))
    return float((off / np.sqrt(np.array(marker["covariance"])[[0, 7, 14]])).max())


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
