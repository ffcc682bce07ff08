"""The contract that every camera keeps: picamera2, a recording, the simulator, V4L2."""

from __future__ import annotations

from typing import Protocol

from ledpi.records import CameraInfo, Frame, PanelValues, Pixels, Rejected


class Camera(Protocol):
    """A configured camera. One thread calls `read`; `close` may be called from another, and ends a waiting `read`."""

    @property
    def info(self) -> CameraInfo:
        """Fixed until it is closed."""
        ...

    @property
    def panel(self) -> PanelValues | None: ...

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
