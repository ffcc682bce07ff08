"""Errors for what goes wrong for good, in one small tree, and text for people, in one line.

What is *expected* to go wrong is a `Rejected` value. `str()` of an error is one line for the user: the file, key or
device, what is wrong, and what would be right; its values are not too long for it. The command line prints it and exits
with status 2: a person has to act. Status 1 is what trying again may put right.
"""

from __future__ import annotations

import reprlib
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum

if sys.version_info >= (3, 11):
    from enum import StrEnum as StrEnum
else:  # Python's own came with 3.11

    class StrEnum(str, Enum):
        """Members are strings, and print as such."""

        __str__ = str.__str__


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


SERVICE_HOME = "/opt/ledpi"  # of scripts/install
VALUE_LENGTH = 60  # characters of a value in a message
LINE_LENGTH = 800  # of a message: a path may have 4096, and what is taken for one any number


def one_line(text: str) -> str:
    """`text` with line breaks, and whatever else does not print, as escapes: file names and keys may hold them.

    What is too long lacks its middle: the beginning says where it is, and the end what would be right.
    """
    line, half = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text), LINE_LENGTH // 2
    return line if len(line) <= LINE_LENGTH else f"{line[: half - 3]}...{line[-half:]}"


def counted(count: int, noun: str) -> str:
    """As in `1 panel`, `0 panels`, `2 panels`, for nouns that take an s."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def shortened(value: object) -> str:
    """`value` as Python writes it, cut to a length that fits a message before it is written: it may be of any size."""
    return _cut(_SHORT.repr(value))


def shortened_name(name: object) -> str:
    """A key, an ID or other words as they are, without quotes; cut likewise."""
    return _cut(name[: VALUE_LENGTH + 1] if isinstance(name, str) else _SHORT.repr(name))


def install_command(extra: str) -> str:
    """Returns what installs an extra for the interpreter that runs: another `pip` on the path would do so elsewhere.

    Where `scripts/install` has installed ledpi, that does it, and remembers it for its next update.
    """
    if sys.prefix == SERVICE_HOME:
        return f"sudo scripts/install --with {extra} (in the clone)"
    return f"{shlex.quote(sys.executable)} -m pip install 'ledpi[{extra}]'"


class _Short(reprlib.Repr):
    def __init__(self) -> None:
        super().__init__()
        self.maxstring = self.maxother = self.maxlong = 2 * VALUE_LENGTH  # more than is left of it, to be cut once

    def repr_int(self, x: int, level: int) -> str:
        """Python refuses to write numbers of more than 4,300 digits."""
        return super().repr_int(x, level) if abs(x) < 1 << 256 else f"a number of {x.bit_length()} bits"


_SHORT = _Short()


def _cut(text: str) -> str:
    return text if len(text) <= VALUE_LENGTH else text[: VALUE_LENGTH - 3] + "..."
