"""A recording with values of the command line in place of its own, as a side or a lens that was measured again."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

from ledpi.camera.recording.reader import Recording, load_recording
from ledpi.config.camera_yaml import load_intrinsics
from ledpi.config.panels import check_bands_visible
from ledpi.config.settings import Config
from ledpi.core.errors import ConfigError, raising
from ledpi.core.records import CameraInfo, PanelSpec

PANEL_KEYS = ("side_m", "black_hz", "white_hz", "duty", "phase")
# They belong to the pictures as they were taken; nothing that is said later changes them.
TAKEN_KEYS = ("width", "height", "frame_duration_us", "analogue_gain")


def load_recording_with(config: Config, folder: Path, *, as_reported: bool = False) -> Recording:
    """The recording in `folder`; what --set gave is stronger than what it says of its camera and its panels.

    `as_reported`: as `load_recording` has it.
    Raises ConfigError for what no recording can be made to have, and what `load_recording` and a lens raise.
    """
    recording = load_recording(folder, as_reported=as_reported)
    _check_taken(config, recording)
    changed = replace(
        recording,
        dictionary=config.panels.dictionary if _given(config, "panels.dictionary") else recording.dictionary,
        panel=_panel(config, recording),
        camera=camera_with(config, recording.camera),
        frames=tuple(replace(entry, exposure_us=config.camera.exposure_us) for entry in recording.frames)
        if _given(config, "camera.exposure_us")
        else recording.frames,
    )
    shown = config.panels.override_with(changed.panel_values)
    check_bands_visible(shown, changed.camera.row_time_us, f"--set: with what {folder} says of its camera and panel")
    return changed


def _given(config: Config, key: str) -> bool:
    return key in config.from_command_line


def _check_taken(config: Config, recording: Recording) -> None:
    for name in TAKEN_KEYS:
        asked = getattr(config.camera, name)
        own = getattr(recording.camera, name, None)  # of a gain, say, each frame has its own
        if _given(config, f"camera.{name}") and asked not in ("auto", own):
            has = "its frames have their own" if own is None else f"its pictures have {own}"
            raise ConfigError(f"--set camera.{name}={asked}: {recording.folder} is recorded, and {has}; leave it out")


def _panel(config: Config, recording: Recording) -> PanelSpec:
    values = asdict(recording.panel)
    given = {name: getattr(config.panels, name) for name in PANEL_KEYS if _given(config, f"panels.{name}")}
    with raising(f"--set panels: with what {recording.folder} says of its panel", ConfigError):
        return PanelSpec(**(values | given))


def camera_with(config: Config, camera: CameraInfo) -> CameraInfo:
    """A recording's or a picture's camera with what --set gave. Raises CalibrationError for a lens."""
    asked = config.camera
    if _given(config, "camera.exposure_us"):
        camera = replace(camera, exposure_us=asked.exposure_us)
    if _given(config, "camera.row_time_us") and asked.row_time_us != "auto":
        # Without the frames' rows, by which the stream would be found to take another time for each.
        camera = replace(camera, row_time_us=asked.row_time_us, frame_length_rows=None)
    if _given(config, "camera.transfer") and asked.transfer != "auto":
        camera = replace(camera, transfer=asked.transfer)
    if _given(config, "camera.rows_from"):
        camera = replace(camera, rows_from=asked.rows_from)
    if _given(config, "camera.intrinsics"):
        path = asked.intrinsics
        camera = replace(
            camera, intrinsics=None if path is None else load_intrinsics(path, (camera.width, camera.height))
        )
    return camera
