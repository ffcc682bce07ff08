"""Builds the compiled core (build_core.py). Everything else that setuptools asks is in pyproject.toml."""

import os
import runpy
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from setuptools import setup
from setuptools.command.build_ext import build_ext

HERE = Path(__file__).resolve().parent
MAKERS = (HERE / "build_core.py", HERE / "setup.py")
OTHER_BUILDS = {"CC", "CFLAGS", "LDFLAGS", "_PYTHON_HOST_PLATFORM"}  # who sets one wants a core of that kind


class BuildOnAllCores(build_ext):
    """Compiles the core's C files side by side; setuptools takes one after the other.

    A core in the source tree that is of these very sources and flags is taken as it is: it serves every interpreter. Of
    a file that has not changed since, the object in build/ is taken.
    """

    taken = False  # the core is the source tree's own

    def build_extension(self, ext: Any) -> None:
        built = HERE / self.get_ext_filename(ext.name)
        if not OTHER_BUILDS & os.environ.keys() and is_fresh(built):
            target = Path(self.get_ext_fullpath(ext.name))
            target.parent.mkdir(parents=True, exist_ok=True)
            if target.resolve() != built:
                shutil.copy2(built, target)
            self.taken = True
            return
        super().build_extension(ext)

    def copy_extensions_to_source(self) -> None:
        if not self.taken:  # a process may have it mapped
            super().copy_extensions_to_source()

    def build_extensions(self) -> None:
        one_by_one = self.compiler.compile
        all_depend = max(path.stat().st_mtime for path in (*MAKERS, *HERE.glob("ledpi/**/*.h")))

        def compiled(source: str, output_dir: str, **kwargs: Any) -> list[str]:
            (name,) = self.compiler.object_filenames([source], output_dir=output_dir)
            newest = max(all_depend, os.stat(source).st_mtime)
            if not OTHER_BUILDS & os.environ.keys() and os.path.exists(name) and os.stat(name).st_mtime > newest:
                return [name]
            return one_by_one([source], output_dir=output_dir, **kwargs)

        def side_by_side(sources: list[str], output_dir: str = "", **kwargs: Any) -> list[str]:
            with ThreadPoolExecutor(os.cpu_count()) as cores:
                objects = list(cores.map(lambda source: compiled(source, output_dir, **kwargs), sources))
            return [name for of_one in objects for name in of_one]

        self.compiler.compile = side_by_side
        super().build_extensions()


def is_fresh(built: Path) -> bool:
    """Asks whether that core was made from the sources beside it (build_core.py compiles their digest in)."""
    digest = runpy.run_path(str(HERE / "build_core.py"))["DIGEST"]
    return (
        built.exists()
        and built.stat().st_mtime > max(path.stat().st_mtime for path in MAKERS)
        and digest.encode() in built.read_bytes()
    )


setup(
    cffi_modules=["build_core.py:ffibuilder"],
    cmdclass={"build_ext": BuildOnAllCores},
    options={"bdist_wheel": {"py_limited_api": "cp310"}},  # cffi builds by the limited API: one wheel for all
)
