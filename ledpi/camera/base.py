"""The contract that every camera keeps: picamera2, a recording, the simulator, V4L2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from ledpi.records import Frame, Intrinsics, Pixels, Rejected, Transfer


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraInfo:
    """What is known of a camera once it is configured. Fixed until it is closed."""

    width: int
    height: int
    exposure_us: float
    row_time_us: float
    transfer: Transfer
    frame_length_rows: int | None = None  # rows in a frame's period, blanking included, where known
    intrinsics: Intrinsics | None = None  # where the source itself knows (a recording, the simulator)


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelValues:
    """What a source knows of the panels that it shows; a recording's own values override the configuration's."""

    dictionary: str
    side_m: float
    black_hz: float
    white_hz: float
    duty: float


class Camera(Protocol):
    """A configured camera. One thread calls `read`; `close` may be called from another, and ends a waiting `read`."""

    @property
    def info(self) -> CameraInfo: ...

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
