"""For tests that hold loops in C to the numpy code that they repeat: what finds and refines squares."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import pytest

from ledpi.kernels import library
from ledpi.kernels.library import COMPILED

Result = TypeVar("Result")

compiled = pytest.mark.skipif(not COMPILED, reason="needs the compiled loops (a C compiler when ledpi was installed)")


def both_ways(call: Callable[[], Result]) -> tuple[Result, Result]:
    """What the loops in C give, and what the numpy code does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(library, "COMPILED", False)
        reference = call()
    return call(), reference
