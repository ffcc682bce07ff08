"""Packages that another one stands in for, or that were built for another Python: which file it is, and what to do.

Such a one is found by what its import, or the first use of it, raises. Nothing is imported here but Python's own.
"""

from __future__ import annotations

import os
import shlex
import sys
from importlib.util import find_spec
from types import ModuleType, TracebackType
from typing import NamedTuple

from ledpi.core.errors import SERVICE_HOME

# Of those whose distribution has another name than the module.
_DISTRIBUTIONS = {"cv2": "opencv-python-headless", "yaml": "PyYAML", "serial": "pyserial", "ruamel": "ruamel.yaml"}


class Unusable(NamedTuple):
    """The fault of a package, and the remedy."""

    said: str
    remedy: str


def unusable(error: ImportError | AttributeError) -> Unusable | None:
    """The package that raised it, or lacks something; None where that is ledpi's own fault."""
    name = _package(error)
    if name is None:
        return None
    file = _file(name)
    said = (str(error).splitlines() or [type(error).__name__])[0]
    if file is None:
        return Unusable(f"{name} cannot be used: {said}", _install(name))
    return Unusable(f"{name} cannot be used: {file}: {said}", _leave_out(name, file) or _install(name))


def versions() -> str:
    """Those of numpy and OpenCV. Raises ImportError or AttributeError where a package that a daemon needs is none."""
    import cv2
    import numpy
    import serial
    import yaml

    _ = cv2.aruco, serial.Serial, yaml.SafeLoader
    return f"numpy {numpy.__version__}, OpenCV {cv2.__version__}"


def tell() -> None:
    """Prints the versions; or, on two lines, what is wrong and what to do, and ends with status 3."""
    try:
        print(versions())
    except (ImportError, AttributeError) as error:
        if (found := unusable(error)) is None:
            raise
        print(f"{found.said}\n{found.remedy}")
        sys.exit(3)


def _package(error: ImportError | AttributeError) -> str | None:
    if isinstance(error, AttributeError):
        name = error.obj.__name__ if isinstance(error.obj, ModuleType) else ""
    else:
        name = error.name or _raised_in(error.__traceback__)
    top = name.partition(".")[0]
    return None if not top or top == "ledpi" or top in sys.stdlib_module_names else top


def _raised_in(trace: TracebackType | None) -> str:
    """The module that raised it."""
    name = ""
    while trace is not None:
        name, trace = str(trace.tb_frame.f_globals.get("__name__", "")), trace.tb_next
    return name


def _file(name: str) -> str | None:
    try:
        spec = find_spec(name)
    except (ImportError, ValueError):
        return None
    if spec is None:
        return None
    return spec.origin or next(iter(spec.submodule_search_locations or ()), None)


def _leave_out(name: str, file: str) -> str:
    for folder in filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep)):
        if file.startswith(os.path.abspath(folder) + os.sep):
            return f"PYTHONPATH brings this {name}: unset PYTHONPATH, or take {folder} out of it"
    return ""


def _install(name: str) -> str:
    if sys.prefix == SERVICE_HOME:
        return "install again: sudo scripts/install"
    package = _DISTRIBUTIONS.get(name, name)
    return f"{shlex.quote(sys.executable)} -m pip install --force-reinstall {package}"
