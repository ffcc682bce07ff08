"""Devices that run on from one daemon to the next, at a reload."""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

from ledpi.camera.base import Camera
from ledpi.core.errors import CameraError
from ledpi.wire.publisher import Publisher


class Left(NamedTuple):
    """Things that a daemon leaves to the next one: running, and not to be opened again."""

    camera: Camera | None
    publisher: Publisher | None

    def close(self) -> None:
        """Closes them, as there is no next one."""
        if self.camera is not None:
            with suppress(CameraError, OSError):
                self.camera.close()
        if self.publisher is not None:
            self.publisher.stop()


NOTHING_LEFT = Left(camera=None, publisher=None)
