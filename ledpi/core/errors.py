"""Errors for what goes wrong for good, in one small tree. What is *expected* to go wrong is a `Rejected` value.

`str()` of each of these is one line for the user: the file, key or device, what is wrong, and what would be right.
The command line prints it and exits with status 2: a person has to act. Status 1 is what trying again may put right.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ledpi.core.wording import one_line


class LedpiError(Exception):
    """Anything that a user can put right."""

    def __str__(self) -> str:
        return one_line(super().__str__())


class ConfigError(LedpiError):
    """config.yaml, or a value given in its place, cannot be used."""


class TransientError(LedpiError):
    """A fault that may come right by itself: exit status 1, after which a service manager tries again."""


class CameraError(LedpiError):
    """A camera cannot be opened, or does not do what was asked of it."""


class RowTimeUnknownError(CameraError):
    """A camera that cannot tell how long a row takes, and `camera.row_time_us` does not say."""


class CameraLostError(CameraError, TransientError):
    """A camera that is not there, is in use, fails as it starts, or delivers no more."""


class RecordingError(CameraError):
    """A recording, or a picture in it, cannot be read or written."""


class PictureError(LedpiError, ValueError):
    """A picture that a program hands over is of another size or kind, or out of its turn."""


class WireError(LedpiError):
    """A serial port or a packet cannot be used."""


class TapError(LedpiError):
    """The tap of a running daemon is not there, or refuses what was asked of it."""


class TapAgainError(TapError, TransientError):
    """The daemon could not do what was asked of it now, as its disk is full; it may the next time."""


class CalibrationError(LedpiError):
    """Calibration input is missing or cannot give a rational result, or a calibration file is broken."""


class DiskFullError(RecordingError, CalibrationError, ConfigError, TransientError):
    """No room for a file, of whatever kind: who expects that it cannot be written hears of it by the usual error."""


class InstallationError(LedpiError):
    """A part of ledpi is missing, or does not fit the rest: it has to be installed again."""


@contextmanager
def raising(
    where: object, kind: type[LedpiError], of: type[Exception] | tuple[type[Exception], ...] = ValueError
) -> Iterator[None]:
    """Raises what is raised within as `kind`, in a line that begins with `where`."""
    try:
        yield
    except of as error:
        raise kind(f"{where}: {getattr(error, 'strerror', None) or error}") from None
