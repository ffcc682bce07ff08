"""The compiled core (`_core`, made from core.h and the C files of FOLDERS), and how arrays are handed to it.

Loading it is as pure as importing numpy: a shared library, once. While one of its functions runs, Python's other
threads do too. Every function takes arrays by `pointer`, of the type that it declares: another is a TypeError.
"""

from __future__ import annotations

from collections.abc import Callable
from hashlib import sha256
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ledpi.core.errors import InstallationError

if TYPE_CHECKING:
    from importlib.abc import Traversable

# C stands beside the Python of its stage; what all share is here. As build_core.py has them.
FOLDERS = ("core", "pose", "decode/finding", "decode/identify", "decode/model")
REMEDY = "install ledpi again: sudo scripts/install, or pip install -e . (needs gcc, libc6-dev, python3-dev)"

try:
    import ledpi.core._core as _core
except ImportError as error:
    raise InstallationError(f"ledpi's compiled core is not there ({error}); {REMEDY}") from error

lib: Any = _core.lib
ffi: Any = _core.ffi

NONE: Any = ffi.NULL
_FROM_BUFFER: Callable[[Any, Any], Any] = ffi.from_buffer
# By numpy's types: masks are bytes, a complex number is two numbers.
_TYPES = {
    np.dtype(numpy): ffi.typeof(f"{c}[]")
    for numpy, c in (
        *((np.float64, "double"), (np.complex128, "double"), (np.float32, "float"), (np.complex64, "float")),
        *((np.bool_, "uint8_t"), (np.uint8, "uint8_t"), (np.int32, "int32_t"), (np.int64, "int64_t")),
    )
}


def pointer(array: NDArray[Any] | None) -> Any:
    """A C-contiguous array's numbers, as C takes them; None is NULL. Raises ValueError where it is not contiguous.

    By the buffer protocol: 0.2 µs, where numpy takes a microsecond to tell an address. A frame asks often.
    """
    return NONE if array is None else _FROM_BUFFER(_TYPES[array.dtype], array)


def doubles(array: NDArray[Any]) -> NDArray[np.float64]:
    """As C wants them: contiguous, 64 bits."""
    return np.ascontiguousarray(array, np.float64)


def digest(package: Traversable) -> str:
    """SHA-256 of the package's C files, then of the headers, in hexadecimal; as build_core.py has it."""
    rooms = [package.joinpath(*folder.split("/")) for folder in FOLDERS]
    every = [file for room in rooms for file in sorted(room.iterdir(), key=lambda file: file.name)]
    sources = [file.read_bytes() for ending in (".c", ".h") for file in every if file.name.endswith(ending)]
    return sha256(b"".join(sources)).hexdigest()


def check(package: Traversable) -> None:
    """Raises InstallationError where the sources there are newer than the core: it would do what older ones say."""
    if ffi.string(lib.ledpi_sources()).decode("ascii") != digest(package):
        raise InstallationError(f"ledpi's compiled core is of other sources than those in {package}; {REMEDY}")


check(files("ledpi"))
