"""`ledpi snapshot --map`: the map from above, and where the robot is in it, of the daemon or in a recording."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from ledpi.camera.recorded import load_recording_with
from ledpi.cli import progress
from ledpi.cli.decode import newest_state, replay_of
from ledpi.cli.pictures import write_drawn
from ledpi.config.camera_yaml import lens_of
from ledpi.config.settings import find_config, load_config
from ledpi.core.errors import ConfigError, RecordingError, TapError, install_command
from ledpi.core.records import Frame, PanelMap
from ledpi.daemon.tap.frames import map_told
from ledpi.page.lines import check_line
from ledpi.page.panels import SIGMAS, robot_from_above, robot_of_state
from ledpi.pipeline.output import decoded_as_json
from ledpi.pipeline.pipeline import load_robot, pipeline_of
from ledpi.workshop.snapshot.sources import connected

LISTEN_S = 1.0  # to the daemon, for its state


class _Plan(NamedTuple):
    title: str
    panels: PanelMap
    robot: dict[str, Any] | None  # as the live page has it


def draw_plan(path: Path | None, config: Path | None, overrides: list[str], seq: int | None, out: Path) -> str:
    """Writes the picture; returns what it shows. Raises LedpiError where there is no map."""
    try:
        from ledpi.workshop.plan import draw_robot, plan_of, png_of
    except ImportError as error:
        raise ConfigError(f"--map: {error.name} is missing: {install_command('calibrate')}") from None
    if path is None and (overrides or seq is not None):
        raise ConfigError(
            "--map: --set, --method and --frame are of a recording; the daemon says where the robot is now"
        )
    plan = _of_daemon(config) if path is None else _of_recording(path, config, overrides, seq)
    axes, said = plan_of(plan.panels), "it is not known where the robot is"
    if (robot := plan.robot) is not None:
        draw_robot(axes, robot, SIGMAS)
        (x, y), heading_deg = robot["position_m"], np.degrees(robot["heading_rad"])
        said = f"robot at {x:+.3f} {y:+.3f} m, heading {heading_deg:+.1f}°, by {robot['by']}"
    axes.set_title(f"{plan.title}: {said}", fontsize=9, parse_math=False)
    write_drawn(out, np.asarray(cv2.imdecode(np.frombuffer(png_of(axes), np.uint8), cv2.IMREAD_COLOR)), "--out")
    return f"{plan.title}: {said}"


def _of_daemon(config: Path | None) -> _Plan:
    """The daemon's state, or, where it tells none, the fix of its newest frame that has one."""
    tap = connected(config)
    if tap is None:
        raise TapError("--map: no daemon runs here (with this configuration); name a recording")
    robot, end_s = None, time.monotonic() + LISTEN_S
    with tap:
        for line in tap.lines(tick_s=LISTEN_S / 10):
            try:
                check_line(line)
                panels = map_told(tap.hello)
            except ValueError as error:
                raise TapError(f"the daemon's line {line['type']} cannot be used: {error}") from None
            if panels is None:
                raise ConfigError("--map: the daemon has no map")
            if line["type"] == "robot_state" and line["position_m"] is not None:
                robot = robot_of_state(line)
                break
            if line["type"] == "decoded":
                robot = robot_from_above(line["robot"]) or robot
            if time.monotonic() > end_s:
                break
        return _Plan(f"running daemon (pid {tap.hello.get('pid')})", panels or {}, robot)


def _of_recording(folder: Path, config: Path | None, overrides: list[str], seq: int | None) -> _Plan:
    """The state as it was told last before a frame, or, where nothing says how the robot moved, that frame's fix."""
    settings = load_config(find_config(config), tuple(overrides), without_file=("panels.side_m=1",))
    if not folder.is_dir():
        raise RecordingError(f"{folder}: is no recording, which --map needs")
    robot = load_robot(settings)
    if robot.panels is None:
        raise ConfigError("--map: map is not set; with a configuration, or --set map=markers.yaml")
    recording = load_recording_with(settings, folder)
    lens = lens_of(recording.camera, settings.camera.intrinsics)
    pipeline = pipeline_of(settings, recording.camera, lens, recording.panel_values, robot=robot)
    replay, placed, seen = replay_of(recording, settings), None, -1
    with progress("decoding", len(recording.frames)) as advance:
        for entry in recording.frames:
            frame = recording.read(entry)
            if not isinstance(frame, Frame):
                placed = placed if replay is not None else None  # a picture that cannot be read has no fix
            else:
                decoded = pipeline.decode(frame)
                if replay is None:
                    placed = robot_from_above(decoded_as_json(decoded, "")["robot"])
                elif told := replay.take(decoded.seq, decoded.markers):
                    state = newest_state(told, replay.host_offset_ns)
                    placed = None if state["position_m"] is None else robot_of_state(state)
            advance(1)
            seen = entry.seq
            if seen == seq:
                break
    if seq not in (None, seen):
        raise RecordingError(f"{folder}: has no frame {seq}")
    sized = {i: replace(p, side_m=p.side_m or pipeline.panels.spec(i).side_m) for i, p in robot.panels.items()}
    return _Plan(f"{folder.resolve().name}, frame {seen}", sized, placed)
