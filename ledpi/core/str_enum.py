"""Python's own StrEnum, which it has from 3.11 on."""

from __future__ import annotations

import sys
from enum import Enum

if sys.version_info >= (3, 11):
    from enum import StrEnum
else:

    class StrEnum(str, Enum):
        """Members are strings, and print as such."""

        __str__ = str.__str__


__all__ = ["StrEnum"]
