"""A frame of the daemon that runs here."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import NamedTuple

from ledpi.config.settings import Config
from ledpi.core.errors import TapError
from ledpi.core.records import CameraInfo, Frame
from ledpi.diagnosis.why_not import RUN_FRAMES
from ledpi.pipeline.of_config import load_robot
from ledpi.pipeline.pipeline import Pipeline
from ledpi.tap.client import Client, connect
from ledpi.tap.frames import camera_of, frame_of


class Taken(NamedTuple):
    """A frame, and what the daemon says of its camera."""

    title: str
    frame: Frame
    camera: CameraInfo
    run: tuple[Frame, ...]  # the last ones, up to it


def connected(config: Path | None) -> Client | None:
    """To the daemon that runs here; None where none does, or where it has another configuration than `config`."""
    try:
        tap = connect()
    except TapError:
        return None
    used = tap.hello.get("config_path")
    if config is None or (used is not None and Path(used) == config.absolute()):
        return tap
    tap.close()
    return None


def showing_a_panel(tap: Client, settings: Config, of_frames: int) -> Taken:
    """The first that shows a panel by itself; where none of so many does, the last, to show why. Raises TapError."""
    camera = camera_of(tap.hello)
    alone = Pipeline(
        camera,
        settings.panels,
        intrinsics=camera.intrinsics,
        robot=load_robot(settings),
        method=settings.decode.method,
        stream=False,
    )
    run: deque[Frame] = deque(maxlen=RUN_FRAMES)
    for _ in range(of_frames):
        frame = frame_of(tap.hello, tap.picture())
        run.append(frame)
        if alone.decode(frame).markers:
            break
    return Taken(f"running daemon (pid {tap.hello.get('pid')}), frame {frame.seq}", frame, camera, tuple(run))
