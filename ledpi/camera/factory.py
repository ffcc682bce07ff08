"""From `camera.source` to an open camera. Each device's module is imported only where it is used."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from ledpi.camera.base import Camera
from ledpi.config.settings import Config
from ledpi.core.errors import CameraError, CameraLostError


def open_camera(
    config: Config, *, paced: bool = True, first: int = 0, frames: int | None = None, recover: bool = False
) -> Camera:
    """Opens what the configuration names.

    `paced` and `frames` are for what has no pace and no end of its own: the simulator and recordings deliver
    frames as a sensor would, or as fast as they are read, and end after `frames` (a shorter recording is
    repeated). The simulator begins with frame `first`. `recover`: a device that is lost is opened again. A recording's
    own values override the configuration's, but for what --set gave. Raises LedpiError.
    """
    kind, _, place = config.camera.source.partition(":")
    if kind == "simulated":
        from ledpi.camera.simulated import open_simulated

        return open_simulated(config, paced=paced, first=first, frames=frames)
    if kind == "recording":
        from ledpi.camera.recorded import RecordingCamera
        from ledpi.camera.recording.overrides import load_recording_with

        recording = load_recording_with(config, Path(place))
        return RecordingCamera(recording, paced=paced, loop=frames is not None, frames=frames)
    if frames is not None or not paced:
        raise CameraError(f"--frames, --unpaced: only for camera.source: simulated or recording:PATH, not {kind}")
    from ledpi.camera.recovering import RecoveringCamera

    device = partial(_open_device, config, kind, place)
    return RecoveringCamera(device) if recover else device()


def is_same_camera(one: Config, other: Config) -> bool:
    """Tells whether `open_camera` opens the same, set up in the same way: what runs by the one will do for the other.

    A lens is no matter of the camera, and panels are none but for the frame period; to the simulator they are.
    """
    if one.camera.source == "simulated":
        return (one.camera, one.panels) == (other.camera, other.panels)
    with_one_lens = other.camera.model_copy(update={"intrinsics": one.camera.intrinsics})
    return one.camera == with_one_lens and one.panels.frequencies_hz() == other.panels.frequencies_hz()


def _open_device(config: Config, kind: str, place: str) -> Camera:
    """Raises CameraLostError for what the system refuses, too: no descriptor left, say, or a node that vanishes."""
    try:
        if kind == "picamera2":
            from ledpi.camera.picamera import open_picamera

            return open_picamera(config.camera, config.panels.frequencies_hz(), int(place or 0))
        from ledpi.camera.v4l2 import open_v4l2

        return open_v4l2(config.camera, place)
    except OSError as error:
        raise CameraLostError(f"{config.camera.source}: {error.strerror or error}") from error
