"""Builds the compiled core: `ledpi.core._core`, one extension of all C files in FOLDERS.

setup.py names `ffibuilder`. cffi makes the bindings from core.h and unknowns.h, which the C files include, too: a
declaration and its function cannot differ. By the limited API, so that one build serves every Python from 3.10 on.
"""

import re
from hashlib import sha256
from pathlib import Path

from cffi import FFI

# C stands beside the Python of its stage; what all share is in core. As library.py has them.
FOLDERS = ("core", "pose", "decode/finding", "decode/identify", "decode/model")
ROOMS = [Path("ledpi") / folder for folder in FOLDERS]  # setuptools runs it in the project's root
SOURCES, HEADERS = ([path for room in ROOMS for path in sorted(room.glob(ending))] for ending in ("*.c", "*.h"))
# Compiled in, so that a core that is older than the sources beside it is told (library.py).
DIGEST = sha256(b"".join(path.read_bytes() for path in (*SOURCES, *HEADERS))).hexdigest()

ffibuilder = FFI()
for header in ("core/core.h", "decode/model/unknowns.h"):  # cffi reads declarations, but no directives
    text = Path("ledpi", header).read_text(encoding="utf-8")
    ffibuilder.cdef(re.sub(r"^#.*$", "", text, flags=re.MULTILINE))
ffibuilder.cdef("char *ledpi_sources(void);")
# What is not finite must stay so (degenerate quads are refused by it): no -ffast-math. No -march=native: a Pi's system
# may be made on another Pi.
ffibuilder.set_source(
    "ledpi.core._core",
    f'#include "core.h"\n#include "unknowns.h"\nstatic char *ledpi_sources(void) {{ return "{DIGEST}"; }}\n',
    sources=[str(path) for path in SOURCES],
    depends=[str(path) for path in HEADERS],
    include_dirs=[str(room) for room in ROOMS],
    extra_compile_args=[
        *("-std=c99", "-O3", "-Wall", "-Wextra", "-Wno-unused-parameter"),  # cffi's own have some
        *("-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast"),
    ],
    libraries=["m"],
)
