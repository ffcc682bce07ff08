"""`analogue_gain: auto` in a running program: looks at each decoded frame, and tells the camera."""

from __future__ import annotations

from ledpi.camera.base import AdjustableGain, Camera
from ledpi.camera.gain import GainControl, brightest_level
from ledpi.core.records import Decoded, Frame


class GainFollower:
    """Does nothing for a camera whose gain is fixed or cannot be set."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera if isinstance(camera, AdjustableGain) and camera.gain_limits is not None else None
        limits = None if self._camera is None else self._camera.gain_limits
        self._control = None if limits is None else GainControl(limits)

    @property
    def settled(self) -> bool:
        """Tells whether there is nothing left to do for now."""
        return self._control is None or self._control.settled

    def update(self, frame: Frame, decoded: Decoded) -> None:
        """After each decoded frame, while its pixels are there."""
        if self._camera is None or self._control is None:
            return
        level = brightest_level(frame, [marker.detection.corners_px for marker in decoded.markers])
        gain = self._control.update(frame.row0_readout_ns, frame.analogue_gain, level)
        if gain is not None:
            self._camera.set_gain(gain)
