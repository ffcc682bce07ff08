"""Bounds of what a foreign file may do: what unpacks it is others' code, with memory and words of its own."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ledpi.core.errors import RecordingError

MAX_BYTES = 1 << 28  # beyond what the process has: the largest picture in colour, four times


@contextmanager
def memory_bounded(path: Path) -> Iterator[None]:
    """Lets the process take no more, and raises RecordingError where it wants to."""
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    has = 1024 * int(Path("/proc/self/status").read_text(encoding="ascii").split("VmData:")[1].split()[0])
    limits = [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_DATA, (min([has + MAX_BYTES, *limits]), hard))
    try:
        yield
    except MemoryError:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))  # the words of the error, too, take some
        most = f"{MAX_BYTES >> 20} MB"
        raise RecordingError(f"{path}: would take more than {most} of memory to read; must be smaller") from None
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


@contextmanager
def libraries_silent() -> Iterator[None]:
    """Lets nothing through of what OpenCV, libpng or libjpeg print of a damaged file: ledpi says it, in one line."""
    errors, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nothing, 2)
        yield
    finally:
        os.dup2(errors, 2)
        os.close(errors)
        os.close(nothing)
