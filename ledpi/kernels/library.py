"""The compiled loops, where a compiler was at hand when ledpi was installed; and how arrays are handed to them.

Loading them is as pure as importing numpy: a shared library from beside this file, once. While one of its functions
runs, Python's other threads do too.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

POINTER, INTEGER, DOUBLE = ctypes.c_void_p, ctypes.c_ssize_t, ctypes.c_double


def _load() -> ctypes.CDLL | None:
    found = find_spec("ledpi.kernels.compiled")
    if found is None or found.origin is None:
        return None
    try:
        return ctypes.CDLL(found.origin)
    except OSError:  # made for another machine
        return None


_LIBRARY = _load()
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
    """Where a C-contiguous array's numbers are, for a POINTER. The array must outlive the call."""
    assert array.flags.c_contiguous
    at: int = array.__array_interface__["data"][0]
    return at


def sources() -> str:
    """SHA-256 of the C files that were compiled, in hexadecimal."""
    said: bytes = function("ledpi_sources", result=ctypes.c_char_p)()
    return said.decode("ascii")


def doubles(array: NDArray[Any]) -> NDArray[np.float64]:
    """As C wants them: contiguous, 64 bits."""
    return np.ascontiguousarray(array, np.float64)
