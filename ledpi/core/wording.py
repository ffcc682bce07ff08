"""Text for people: in one line, with values not too long for it, and with nouns that suit their number."""

from __future__ import annotations

import reprlib
import shlex
import sys
from enum import Enum

if sys.version_info >= (3, 11):
    from enum import StrEnum as StrEnum
else:  # Python's own came with 3.11

    class StrEnum(str, Enum):
        """Members are strings, and print as such."""

        __str__ = str.__str__


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
