"""Builds the compiled core (build_core.py). Everything else that setuptools asks is in pyproject.toml."""

from setuptools import setup

setup(
    cffi_modules=["build_core.py:ffibuilder"],
    options={"bdist_wheel": {"py_limited_api": "cp310"}},  # cffi builds by the limited API: one wheel for all
)
