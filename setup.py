"""Builds the compiled core (build_core.py). Everything else that setuptools asks is in pyproject.toml."""

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from setuptools import setup
from setuptools.command.build_ext import build_ext


class BuildOnAllCores(build_ext):
    """Compiles the core's C files side by side; setuptools takes one after the other."""

    def build_extensions(self) -> None:
        one_by_one = self.compiler.compile

        def side_by_side(sources: list[str], *args: Any, **kwargs: Any) -> list[str]:
            with ThreadPoolExecutor(os.cpu_count()) as cores:
                objects = list(cores.map(lambda source: one_by_one([source], *args, **kwargs), sources))
            return [name for of_one in objects for name in of_one]

        self.compiler.compile = side_by_side
        super().build_extensions()


setup(
    cffi_modules=["build_core.py:ffibuilder"],
    cmdclass={"build_ext": BuildOnAllCores},
    options={"bdist_wheel": {"py_limited_api": "cp310"}},  # cffi builds by the limited API: one wheel for all
)
