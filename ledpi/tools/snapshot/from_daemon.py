"""A frame of the daemon that runs here."""

from __future__ import annotations

from dataclasses import asdict
from typing import NamedTuple

from ledpi.config.panels import PanelSettings
from ledpi.core.errors import ConfigError, TapError
from ledpi.core.records import CameraInfo, Frame, PanelValues
from ledpi.pipeline.pipeline import Pipeline
from ledpi.tap.client import Client
from ledpi.tap.frames import camera_of, frame_of, panel_of


class Taken(NamedTuple):
    """A frame, and what the daemon says of its camera and its panels."""

    title: str
    frame: Frame
    camera: CameraInfo
    panel: PanelValues


def showing_a_panel(tap: Client, of_frames: int) -> Taken:
    """The first that shows a panel by itself; where none of so many does, the last, to show why. Raises TapError."""
    camera, panel = camera_of(tap.hello), panel_of(tap.hello)
    try:
        alone = Pipeline(camera, PanelSettings(**asdict(panel)), intrinsics=camera.intrinsics, stream=False)
    except (ValueError, ConfigError) as error:  # a dictionary of its own, say, that cannot be read from here
        raise TapError(f"{tap.path}: the daemon's panels cannot be used here: {error}") from None
    for _ in range(of_frames):
        frame = frame_of(tap.hello, tap.picture())
        if alone.decode(frame).markers:
            break
    return Taken(f"running daemon (pid {tap.hello.get('pid')}), frame {frame.seq}", frame, camera, panel)
