"""Messages of the daemon on its tap: records of the path → JSON objects."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from ledpi import __version__
from ledpi.config.panels import PanelSettings
from ledpi.core.errors import one_line
from ledpi.core.geometry import quaternion_from_matrix
from ledpi.core.records import CameraInfo, Decoded, Floats, Frame, Intrinsics, PanelMap, Pixels, Rejected
from ledpi.core.shutter import row_mid_exposure_ns
from ledpi.daemon.tap.protocol import VERSION, Request
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.decision import Reading
from ledpi.pipeline.output import decoded_as_json, state_as_json
from ledpi.pipeline.trace import SquareTrace, Trace, class_given_others, classes_unread
from ledpi.state.estimator import State
from ledpi.wire.state_message import StateMessage

SATURATED = 255
FAULTS = 20
MOST_SAID = 300  # characters of one of them


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """Facts that stay as they are from one reload to the next."""

    pid: int
    camera: CameraInfo
    source: str
    intrinsics: Intrinsics | None
    panels: PanelSettings  # with what the source knows better
    panel_map: PanelMap | None
    values: dict[str, Any]  # of the configuration, by dotted key
    origins: dict[str, str]  # where each of them comes from
    config_path: str | None  # None: there is no file


class Shown(NamedTuple):
    """A frame that was decoded, on its way to the followers."""

    number: int  # counted since the daemon began, with those that nobody was told of
    frame: Frame  # without its picture
    decoded: Decoded
    done_ns: int  # CLOCK_MONOTONIC
    rows: int  # of the picture
    pixels: Pixels | None = None  # (H, W), a copy, where somebody asked
    trace: Trace | None = None  # likewise


def hello(setup: Setup, may: Sequence[str]) -> dict[str, Any]:
    """The first line. `may`: the commands that this client may give."""
    camera, panels = setup.camera, setup.panels
    lens = None
    if setup.intrinsics is not None:
        lens = asdict(setup.intrinsics)
        del lens["width"], lens["height"]
    return {
        "type": "hello",
        "tap": VERSION,
        "version": __version__,
        "pid": setup.pid,
        "camera": {
            "source": setup.source,
            "width": camera.width,
            "height": camera.height,
            "row_time_us": camera.row_time_us,
            "exposure_us": camera.exposure_us,
            "frame_length_rows": camera.frame_length_rows,
            "transfer": camera.transfer,
            "rows_from": camera.rows_from,
            **(lens or dict.fromkeys(("fx", "fy", "cx", "cy", "distortion", "distortion_model"))),
        },
        "panels": panels.model_dump(mode="json"),
        "method": setup.values.get("decode.method"),
        "camera_mount": {key: setup.values.get(f"robot.camera_mount.{key}") for key in ("position_m", "rpy_deg")},
        "config_path": setup.config_path,
        "map": None if setup.panel_map is None else _map(setup.panel_map, panels),
        "may": list(may),
        "dropped": 0,
    }


def _map(panel_map: PanelMap, panels: PanelSettings) -> dict[str, Any]:
    known = range(len(panels.words.codewords))
    return {
        str(marker_id): {
            "position_m": _rounded(panel.map_from_marker[:3, 3], 6),
            "quaternion_wxyz": _rounded(quaternion_from_matrix(panel.map_from_marker[:3, :3]), 7),
            "side_m": panel.side_m or panels.spec(marker_id).side_m,
        }
        for marker_id, panel in panel_map.items()
        if marker_id in known
    }


def decoded(shown: Shown) -> dict[str, Any]:
    """The line of each frame, but for `dropped`, which is each client's own."""
    frame, offset_ns = shown.frame, shown.frame.host_offset_ns
    values = decoded_as_json(shown.decoded, "")
    for told, marker in zip(values["markers"], shown.decoded.markers, strict=True):
        told["exposed_ns"] = marker.mid_exposure_ns + offset_ns
    for told, body in zip(values.get("bodies", ()), shown.decoded.bodies, strict=True):
        told["exposed_ns"] = body.mid_exposure_ns + offset_ns
    if shown.decoded.robot is not None:
        values["robot"]["exposed_ns"] = shown.decoded.robot.mid_exposure_ns + offset_ns
    return {
        "type": "decoded",
        **values,
        "exposed_ns": row_mid_exposure_ns(frame, (shown.rows - 1) / 2) + offset_ns,
        "decoded_ns": shown.done_ns,
        "exposure_us": frame.exposure_us,
        "analogue_gain": frame.analogue_gain,
    }


def robot_state(found: State | None, t_ns: int, message: StateMessage) -> dict[str, Any]:
    """The robot's state at a time; its numbers are null where there is none."""
    own = {"clock_us": message.clock_us, "map_resets": message.map_resets}
    return {"type": "robot_state", **state_as_json(found, t_ns), **own}


def ready_ns(shown: Shown) -> int:
    """When the frame's last row was read out, CLOCK_MONOTONIC."""
    frame = shown.frame
    return frame.row0_readout_ns + round(shown.rows * frame.row_time_us * 1e3) + frame.host_offset_ns


def picture(shown: Shown, request: Request, panels: PanelSettings) -> dict[str, Any]:
    """The line before a picture's bytes. `shown` has its pixels, and its trace where the request has extras."""
    assert shown.pixels is not None
    height, width = shown.pixels.shape
    values: dict[str, Any] = {
        "type": "picture",
        "id": request.id,
        "width": width,
        "height": height,
        "format": "gray8",
        "bytes": shown.pixels.size,
        "pixels_max_share": round(np.count_nonzero(shown.pixels == SATURATED) / shown.pixels.size, 6),
        "decoded": decoded(shown),
    }
    if shown.trace is not None and "rejected" in request.extras:
        values["rejected"] = [
            {"corners_px": _corners(dropped.corners_px), "why": dropped.why.key, "id": dropped.marker_id}
            for dropped in shown.trace.dropped
        ]
    if shown.trace is not None and "evidence" in request.extras:
        values["looks"] = [_look(square, panels) for square in shown.trace.squares]
    return values


def _look(square: SquareTrace, panels: PanelSettings) -> dict[str, Any]:
    read = square.reading if isinstance(square.reading, Reading) else None
    return {
        "corners_px": _corners(square.quad.corners_px),
        "id": None if read is None else read.id,
        "margin": None if read is None else round(read.margin, 2),
        "why": square.reading.key if isinstance(square.reading, Rejected) else None,
        "cells_nats": _cells(square, panels),
    }


def _cells(square: SquareTrace, panels: PanelSettings) -> list[float] | None:
    """The first is at the first corner, the row goes toward the second. None where no cell says anything by itself."""
    evidence, reading = square.evidence, square.reading
    if isinstance(evidence, Evidence) and isinstance(reading, Reading):
        word = np.rot90(panels.words.codeword(reading.id), -reading.quarter_turns)
        return _rounded(class_given_others(evidence, reading.cell_bands, word.ravel()), 1)
    nats = classes_unread(square)
    return None if nats is None else _rounded(nats.ravel(), 1)


def _corners(corners_px: Floats) -> list[list[float]]:
    return [_rounded(corner, 2) for corner in corners_px]


def _rounded(values: Floats, digits: int) -> list[float]:
    return [round(float(value), digits) for value in values]


class Faults(logging.Handler):
    """The log's newest warnings, from its making to `close`, for people who have no journal at hand."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._kept: deque[dict[str, Any]] = deque(maxlen=FAULTS)
        logging.getLogger("ledpi").addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        """With the time on CLOCK_MONOTONIC, as all times of the tap are."""
        self._kept.append({"at_ns": time.monotonic_ns(), "text": one_line(record.getMessage())[:MOST_SAID]})

    def kept(self) -> list[dict[str, Any]]:
        """Oldest first: {"at_ns", "text"}."""
        return list(self._kept)

    def close(self) -> None:
        """Hears no more."""
        logging.getLogger("ledpi").removeHandler(self)
        super().close()
