"""Which picamera2 and libcamera are installed, and which ones ledpi can use."""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError, version
from types import ModuleType

from ledpi.core.errors import CameraError, CameraLostError

OLDEST = "0.3.20"  # the first that can end a wait for a frame (cancel_all_and_flush)
UPDATE = "sudo apt update && sudo apt full-upgrade"


def picamera2_version() -> str | None:
    """As `0.3.31`; None where it does not say."""
    try:
        return version("picamera2")
    except PackageNotFoundError:
        return None


def is_too_old(picamera2: str | None) -> bool:
    """Tells whether it is; of one that does not say its version, nobody knows."""
    return picamera2 is not None and _numbers(picamera2) < _numbers(OLDEST)


def _numbers(said: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", said)[:3])


def versions(libcamera: ModuleType | None) -> str:
    """Names both, as what begins an error's line."""
    manager = getattr(libcamera, "CameraManager", None)
    libcameras = getattr(manager, "version", "of unknown version")
    return f"picamera2 {picamera2_version() or 'of unknown version'}, libcamera {libcameras}"


def unforeseen(error: Exception, libcamera: ModuleType | None) -> CameraError:
    """The error of what nobody has foreseen, with the versions. Of a version that fits, a new start may do better."""
    found = picamera2_version()
    said = f"{versions(libcamera)}: {type(error).__name__}: {error}"
    if found is not None and not is_too_old(found):
        return CameraLostError(said)
    return CameraError(f"{said}; needs picamera2 {OLDEST} or newer: {UPDATE}")
