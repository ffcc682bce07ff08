"""Builds the compiled core: `ledpi.kernels._core`, one extension of all C files in ledpi/kernels.

setup.py names `ffibuilder`. cffi makes the bindings from core.h, which the C files include, too: a declaration and its
function cannot differ. By Python's limited API, so that one build serves every version from 3.10 on.
"""

import re
from hashlib import sha256
from pathlib import Path

from cffi import FFI

FOLDER = Path("ledpi/kernels")  # setuptools runs it in the project's root
SOURCES, HEADERS = sorted(FOLDER.glob("*.c")), sorted(FOLDER.glob("*.h"))
# Compiled in, so that a core that is older than the sources beside it is told (library.py).
DIGEST = sha256(b"".join(path.read_bytes() for path in (*SOURCES, *HEADERS))).hexdigest()

ffibuilder = FFI()
# cffi reads declarations, but no directives.
ffibuilder.cdef(re.sub(r"^#.*$", "", (FOLDER / "core.h").read_text(encoding="utf-8"), flags=re.MULTILINE))
ffibuilder.cdef("char *ledpi_sources(void);")
# What is not finite must stay so (degenerate quads are refused by it): no -ffast-math. No -march=native: a Pi's system
# may be made on another Pi.
ffibuilder.set_source(
    "ledpi.kernels._core",
    f'#include "core.h"\nstatic char *ledpi_sources(void) {{ return "{DIGEST}"; }}\n',
    sources=[str(path) for path in SOURCES],
    depends=[str(path) for path in HEADERS],
    include_dirs=[str(FOLDER)],
    extra_compile_args=[
        *("-std=c99", "-O3", "-Wall", "-Wextra", "-Wno-unused-parameter"),  # cffi's own have some
        *("-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast"),
    ],
    libraries=["m"],
)
