"""Constants that stand in C and in numpy, which repeats the loops: the same in both."""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping
from pathlib import Path

import pytest

import ledpi.kernels

SOURCES = Path(ledpi.kernels.__file__).parent
DEFINED = re.compile(r"^#define (\w+) \(?(-?[\d.]+(?:e-?\d+)?)f?\)?(?:\s|$)", re.MULTILINE)
COUNTED = re.compile(r"(\w+) = (\d+)(?=[,}\s])(?! \*)")

# By C source: the modules whose numpy code it repeats, and how many constants they share.
SHARED = {
    "adjust.c": (("corners.adjust",), 8),
    "inner_lines.c": (("corners.inner_lines",), 7),
    "sides.c": (("corners.sides",), 2),
    "whole.c": (("corners.whole",), 2),
    "band_light.c": (("striped.band_light", "striped.light_window"), 7),
    "panel_fit.c": (("striped.numpy_panel_fit", "striped.numpy_panel_model"), 7),
    "rim.h": (("corners.rim",), 1),
    "lattice.h": (("corners.inner_lines",), 1),
    "crossings.c": (("finding.crossings",), 13),
    "grids.c": (("finding.crossings",), 3),
    "inner_square.c": (("corners.inner_square", "corners.adjust"), 10),
}


def of_c(source: str) -> dict[str, float]:
    """The numbers that have a name there."""
    counts = [found for block in re.findall(r"enum \{(.*?)\}", source, re.DOTALL) for found in COUNTED.findall(block)]
    return {name: float(value) for name, value in [*DEFINED.findall(source), *counts]}


def of_numpy(modules: tuple[str, ...]) -> Mapping[str, float]:
    """The same of these modules of ledpi.decode."""
    names = [vars(importlib.import_module(f"ledpi.decode.{module}")) for module in modules]
    return {name: value for each in names for name, value in each.items() if isinstance(value, int | float)}


@pytest.mark.parametrize("source", SHARED)
def test_c_and_numpy_have_the_same_constants(source: str) -> None:
    """Whoever changes one of two is told of the other."""
    modules, count = SHARED[source]
    c, numpy = of_c((SOURCES / source).read_text(encoding="utf-8")), of_numpy(modules)
    shared = c.keys() & numpy.keys()
    assert len(shared) >= count, sorted(shared)
    assert {name: c[name] for name in shared} == {name: numpy[name] for name in shared}


def test_numbers_are_found_in_c() -> None:
    """Signs, exponents, floats, and what an enum counts; not what is computed."""
    source = "#define LOW (-0.3f)\n#define TINY 1e-4 /* of it */\nenum { A = 3, B = 2 * A, C = 5 };\n#define T f(3)\n"
    assert of_c(source) == {"LOW": -0.3, "TINY": 1e-4, "A": 3.0, "C": 5.0}
