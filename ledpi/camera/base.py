"""The contract that every camera keeps: picamera2, a recording, the simulator, V4L2; and who tells it its gain."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from ledpi.camera.gain import GainControl, brightest_level
from ledpi.core.records import CameraInfo, Decoded, Frame, PanelValues, Pixels, Rejected


class Camera(Protocol):
    """A configured camera. One thread calls `read`; `close` may be called from another, and ends a waiting `read`."""

    @property
    def info(self) -> CameraInfo:
        """Fixed until it is closed."""
        ...

    @property
    def panel(self) -> PanelValues | None:
        """Tells what a recording says of its own panels, and the simulator of those that it draws; else None."""
        ...

    def read(self, into: Pixels) -> Frame | Rejected | None:
        """Waits for the next frame and puts its luma into `into` (height, width), uint8, C-contiguous.

        Returns the frame, whose `pixels` is a read-only view of `into`; `Rejected` for a single frame that cannot
        be used (the next call goes on with the one after it); None when there will be no further frame.
        Raises CameraError when the camera fails.
        """
        ...

    def close(self) -> None:
        """Releases the device. Safe to call twice."""
        ...


@runtime_checkable
class AdjustableGain(Protocol):
    """A camera whose gain can follow the panels."""

    @property
    def gain_limits(self) -> tuple[float, float] | None:
        """Least and most analogue gain; None where the configuration fixes it."""
        ...

    def set_gain(self, gain: float) -> None:
        """From some frame on; every frame says its own gain. From any thread."""
        ...


def frame_by(camera: CameraInfo, pixels: Pixels, seq: int = 0, row0_readout_ns: int = 0) -> Frame:
    """The frame of a picture that this camera has taken, exposed as it says."""
    return Frame(
        pixels=pixels,
        seq=seq,
        row0_readout_ns=row0_readout_ns,
        exposure_us=camera.exposure_us,
        row_time_us=camera.row_time_us,
        transfer=camera.transfer,
    )


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
