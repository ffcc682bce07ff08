"""From `camera.source` to an open camera, and notes on its exposure. A device is imported only where it is used."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from ledpi.camera.base import Camera
from ledpi.camera.timing import exposure_honoured
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import Config
from ledpi.core.errors import CameraError, CameraLostError
from ledpi.core.records import CameraInfo
from ledpi.core.shutter import contrast


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
        from ledpi.camera.recorded import RecordingCamera, load_recording_with

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


# Of the depth that the best exposure of about this length would give; below it a class is near a null, where it can
# hardly be seen.
MIN_SHARE_OF_CONTRAST = 0.2


def other_exposure(config: Config, info: CameraInfo) -> str | None:
    """Says where the camera exposes for another time than was asked for, by more than its whole rows explain.

    None for a recording, which was exposed before it was asked.
    """
    asked_us = config.camera.exposure_us
    if config.camera.source.startswith("recording:"):
        return None
    if exposure_honoured(asked_us=asked_us, reported_us=info.exposure_us, row_time_us=info.row_time_us):
        return None
    return f"the camera exposes for {info.exposure_us:.0f} µs, where {asked_us:g} µs were asked for"


def depths(panels: PanelSettings, exposure_us: float) -> dict[float, float]:
    """Returns how deep the bands of each frequency are, over the mean light, at the panels' least favourable duty."""
    duties = {panels.duty, *(o.duty for o in panels.overrides.values() if o.duty is not None)}
    return {hz: min(contrast(hz, exposure_us, duty) for duty in duties) for hz in panels.frequencies_hz()}


def vanishing(panels: PanelSettings, exposure_us: float) -> list[float]:
    """The frequencies of which this exposure leaves next to no bands: it holds a whole number of their cycles."""
    return [
        hz
        for hz, depth in depths(panels, exposure_us).items()
        if depth < MIN_SHARE_OF_CONTRAST * min(2.0, 1e6 / (hz * exposure_us))
    ]


def exposure_notes(config: Config, panels: PanelSettings, info: CameraInfo) -> list[str]:
    """A line for each thing that is wrong with it; `panels` are those that are looked for."""
    notes = []
    if (other := other_exposure(config, info)) is not None:
        notes.append(f"camera.exposure_us: {other}")
    if weak := vanishing(panels, info.exposure_us):
        named = " and ".join(f"{hz:g}" for hz in weak)
        notes.append(
            f"camera.exposure_us: {info.exposure_us:.0f} µs are near a null of {named} Hz: "
            "such bands all but vanish, and panels are not read; exposure × frequency must be near a whole number and "
            "a half (`ledpi panel design`)"
        )
    return notes
