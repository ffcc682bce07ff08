"""ledpi: the lighting is the marker. docs/python.md shows how programs use it; README.md what it is.

Nothing is loaded before it is asked for: the command's entry point is here, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ledpi.core.errors import LedpiError, PictureError
    from ledpi.daemon.tap.client import connect as connect_tap
    from ledpi.pipeline.api import Body, Fix, Lens, Marker, Reader, Reason, State, Stream

__version__ = "0.2.0"
__all__ = [
    "Body",
    "Fix",
    "LedpiError",
    "Lens",
    "Marker",
    "PictureError",
    "Reader",
    "Reason",
    "State",
    "Stream",
    "__version__",
    "connect_tap",
]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name == "connect_tap":
        from ledpi.daemon.tap.client import connect

        return connect
    from ledpi.core import errors
    from ledpi.pipeline import api

    return getattr(errors if name.endswith("Error") else api, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
