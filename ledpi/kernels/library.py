"""The compiled loops, where a compiler was at hand when ledpi was installed; and how arrays are handed to them.

Loading them is as pure as importing numpy: a shared library and its sources from beside this file, once. While one of
its functions runs, Python's other threads do too.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from hashlib import sha256
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any

import numpy as np
from numpy.typing import NDArray

POINTER, INTEGER, DOUBLE = ctypes.c_void_p, ctypes.c_ssize_t, ctypes.c_double
_BYTE_OF: Callable[[Any], ctypes.c_char] = ctypes.c_char.from_buffer


def load(folder: Traversable) -> ctypes.CDLL | None:
    """The library in this folder, if it can be used: made for this machine, and of the sources that lie beside it.

    One that is older than they are (sources that were updated and not installed anew) takes other arguments.
    """
    made = [folder / f"compiled{suffix}" for suffix in EXTENSION_SUFFIXES]
    try:
        library = ctypes.CDLL(str(next(file for file in made if file.is_file())))
    except (StopIteration, OSError):
        return None
    return library if sources_of(library) == digest(folder) else None


def sources_of(library: ctypes.CDLL) -> str:
    """`digest` of the sources that were compiled."""
    library.ledpi_sources.restype = ctypes.c_char_p
    said: bytes = library.ledpi_sources()
    return said.decode("ascii")


def digest(folder: Traversable) -> str:
    """SHA-256 of the C files there, then of the headers, in hexadecimal; as setup.py has it."""
    by_name = {file.name: file for file in folder.iterdir()}
    names = [name for ending in (".c", ".h") for name in sorted(by_name) if name.endswith(ending)]
    return sha256(b"".join(by_name[name].read_bytes() for name in names)).hexdigest()


_LIBRARY = load(files("ledpi.kernels"))
COMPILED = _LIBRARY is not None


def compiled() -> bool:
    """Whether to call the loops. Asked at each call, so that tests can have the numpy code called instead."""
    return COMPILED


def function(name: str, *arguments: Any, result: Any = None) -> Callable[..., Any]:
    """The C function `name`, its arguments' and its result's types given. Only to be called where `compiled`."""
    if _LIBRARY is None:
        return _not_compiled
    found = getattr(_LIBRARY, name)
    found.argtypes, found.restype = arguments, result
    return found  # type: ignore[no-any-return]


def _not_compiled(*_: Any) -> Any:
    raise RuntimeError("ledpi's loops are not compiled: ask ledpi.kernels.library.compiled first")


def address(array: NDArray[Any]) -> int:
    """Where a C-contiguous array's numbers are, for a POINTER. The array must outlive the call.

    By way of the buffer protocol, in a fifth of the time that numpy takes to describe an array: a frame asks often.
    """
    try:
        return ctypes.addressof(_BYTE_OF(array))
    except (TypeError, ValueError):  # not to be written to, or empty
        assert array.flags.c_contiguous
        at: int = array.__array_interface__["data"][0]
        return at


def doubles(array: NDArray[Any]) -> NDArray[np.float64]:
    """As C wants them: contiguous, 64 bits."""
    return np.ascontiguousarray(array, np.float64)
