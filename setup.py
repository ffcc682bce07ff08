"""Compiles the hot loops, ledpi/kernels/*.c. Everything else that setuptools asks is in pyproject.toml.

Optional: without a compiler the installation succeeds, and the numpy code that the loops repeat is used.
"""

from hashlib import sha256
from pathlib import Path

from setuptools import Extension, setup

FOLDER = Path("ledpi/kernels")
sources, headers = sorted(FOLDER.glob("*.c")), sorted(FOLDER.glob("*.h"))
# Compiled in, so that a library that is older than its sources is not used (`digest` in ledpi/kernels/library.py).
digest = sha256(b"".join(path.read_bytes() for path in (*sources, *headers))).hexdigest()

# One library of plain C functions, no Python module: ctypes loads it (ledpi/kernels/library.py), and no headers of
# Python's are needed. What is not finite must stay so (degenerate quads are refused by it): no -ffast-math. No
# -march=native: a Pi's system may be made on another Pi.
setup(
    ext_modules=[
        Extension(
            "ledpi.kernels.compiled",
            sources=[str(path) for path in sources],
            depends=[str(path) for path in headers],
            define_macros=[("LEDPI_SOURCES", f'"{digest}"')],
            extra_compile_args=[
                *("-std=c99", "-O3", "-Wall", "-Wextra"),
                *("-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast"),
            ],
            libraries=["m"],
            optional=True,
        )
    ]
)
