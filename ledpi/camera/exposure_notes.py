"""Notes on the exposure that a person should have before they wonder why no panel is read."""

from __future__ import annotations

from ledpi.camera.timing import exposure_honoured
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import Config
from ledpi.core.records import CameraInfo
from ledpi.core.shutter import contrast

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
