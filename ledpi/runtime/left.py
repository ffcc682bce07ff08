"""Devices that run on from one daemon to the next, at a reload."""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

from ledpi.camera.base import Camera
from ledpi.config.settings import Config
from ledpi.core.errors import CameraError
from ledpi.core.records import Floats
from ledpi.wire.ear import Ear
from ledpi.wire.mavlink import Mavlink
from ledpi.wire.publisher import Publisher
from ledpi.wire.resets import Resets


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


def publisher_of(
    config: Config, base_link_from_camera: Floats, resets: Resets, ear: Ear | None, left: Publisher | None = None
) -> Publisher:
    """The one that was left, as this configuration has it, or a new one, not started.

    Raises ConfigError where MAVLink is asked for and pymavlink is missing.
    """
    mavlink = None
    if config.serial.protocol == "mavlink":
        mavlink = Mavlink(
            base_link_from_camera=base_link_from_camera,
            profile=config.serial.mavlink_profile,
            system=config.serial.mavlink_system,
            resets=resets,
        )
    if left is None:
        return Publisher(config.serial, mavlink, map_resets=resets.maps, ear=ear)
    left.begin_anew(config.serial, mavlink, map_resets=resets.maps, ear=ear)
    return left
