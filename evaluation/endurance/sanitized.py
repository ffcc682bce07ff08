"""ledpi's C core, built with gcc's sanitizers, and what it takes to run Python on it.

They end the process, with a report on standard error: at a read or write beside what was allocated, at a use after
free, at arithmetic that C does not define, and at a number that is too large for the integer that it is made.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from evaluation import ROOT

FLAGS = "-fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all -fno-omit-frame-pointer -g"
LEFT_OUT = shutil.ignore_patterns(".*", "*.so", "build", "*.egg-info", "docs", "tests", "evaluation", "__pycache__")
READ_BESIDE = """
import numpy as np
from ledpi.core.library import ffi, lib, pointer
pixels, room, corners = np.zeros(99, np.uint8), np.zeros(lib.ledpi_lattice_room(10, 10), np.uint8), np.zeros((1, 4, 2))
pictures = ffi.new("PyramidPicture[]", [(pointer(pixels), 10, 10)])
lib.ledpi_lattice_squares(pictures, 1, 4, pointer(room), 1, pointer(corners))
"""


def build(folder: Path) -> Path:
    """Installs a copy of this clone in `folder`; returns where. Raises RuntimeError where its core is not watched."""
    source, built = folder / "source", folder / "built"
    shutil.copytree(ROOT, source, ignore=LEFT_OUT)
    install = ["pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps", "--target", str(built)]
    flags = {"CFLAGS": FLAGS, "LDFLAGS": FLAGS}
    subprocess.run([sys.executable, "-m", *install, str(source)], env=os.environ | flags, check=True)
    if not any(b"__asan_" in core.read_bytes() for core in built.glob("ledpi/core/*.so")):
        raise RuntimeError("the core was not built with sanitizers")
    shutil.copytree(ROOT / "evaluation", built / "evaluation", ignore=LEFT_OUT)  # which attack it
    return built


def environment(built: Path) -> dict[str, str]:
    """In which Python takes ledpi from `built`, and each allocation is watched, numpy's too."""
    runtimes = [
        subprocess.run(["gcc", f"-print-file-name={name}"], capture_output=True, text=True, check=True).stdout.strip()
        for name in ("libasan.so", "libstdc++.so.6")  # the second one, as OpenCV's exceptions are watched, too
    ]
    return os.environ | {
        "LD_PRELOAD": " ".join(runtimes),
        "ASAN_OPTIONS": "detect_leaks=0",  # Python never frees what lives as long as it does
        "UBSAN_OPTIONS": "print_stacktrace=1",
        "PYTHONMALLOC": "malloc",
        "PYTHONPATH": str(built),
        "OPENBLAS_NUM_THREADS": "1",
    }


def check_it_sees(run_in: dict[str, str]) -> None:
    """Raises RuntimeError where the core that Python takes reads beside a numpy array, and that is not reported.

    Silence would mean nothing then: another core is taken, or numpy's memory is not watched.
    """
    command = [sys.executable, "-P", "-c", READ_BESIDE]
    done = subprocess.run(command, env=run_in, capture_output=True, text=True, check=False)
    if done.returncode == 0 or "heap-buffer-overflow" not in done.stderr:
        raise RuntimeError(f"the sanitizers do not see what they should: {done.stderr[-2000:]}")
