"""The core: that it is there, and that it is this one."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from evaluation.endurance.attack import READ_BESIDE
from ledpi.core.errors import InstallationError
from ledpi.core.library import FOLDERS, NONE, check, lib, pointer
from tests.builders import ROOT

PACKAGE = ROOT / "ledpi"
SOURCES_ONLY = shutil.ignore_patterns("*.so", "__pycache__", "tools", "view", "shipped-files")


# ---- The build


@pytest.mark.parametrize("updated", ["core/lens.c", "pose/pose.h", "decode/model/panel_fit.c"])
def test_the_core_is_of_its_own_sources(updated: str, tmp_path: Path) -> None:
    """After an update that was not installed anew an old core does what older sources say; the error has a remedy."""
    package = tmp_path / "ledpi"
    shutil.copytree(PACKAGE, package, ignore=SOURCES_ONLY)
    check(package)
    with (package / updated).open("a") as source:
        source.write("/* updated */\n")
    with pytest.raises(InstallationError, match=r"other sources than .*ledpi; install ledpi again: .*gcc"):
        check(package)


@pytest.mark.slow
@pytest.mark.parametrize("width", [4, 8])
def test_the_core_compiles_for_registers_of_either_width(width: int) -> None:
    """Four numbers at once as on 64-bit ARM, eight as elsewhere; without a warning."""
    folders = [PACKAGE / folder for folder in FOLDERS]
    sources = [path for folder in folders for path in sorted(folder.glob("*.c"))]
    options = ["-fsyntax-only", "-std=c99", "-Wall", "-Wextra", "-Wno-unused-parameter", "-Werror"]
    include = [f"-I{folder}" for folder in folders]
    subprocess.run(["gcc", *options, f"-DLEDPI_WIDTH={width}", *include, *sources], check=True)


def test_without_a_core_the_remedy_is_said() -> None:
    """In one line, by whatever needs it first."""
    code = "import sys; sys.modules['ledpi.core._core'] = None; import ledpi.decode.evidence.cells"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "InstallationError: ledpi's compiled core is not there" in done.stderr.splitlines()[-1]


@pytest.mark.slow
def test_without_a_compiler_the_installation_fails(tmp_path: Path) -> None:
    """Instead of one that cannot read a panel."""
    pytest.importorskip("cffi")
    for name in ("setup.py", "build_core.py"):
        shutil.copy(ROOT / name, tmp_path)
    shutil.copytree(PACKAGE, tmp_path / "ledpi", ignore=SOURCES_ONLY)
    command = [sys.executable, "setup.py", "build_ext", "--inplace"]
    environment = {**os.environ, "CC": str(tmp_path / "no-such-compiler")}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "no-such-compiler" in done.stdout + done.stderr


def test_arrays_are_handed_over_by_their_type() -> None:
    """One of another type, or with gaps, is refused before C sees it."""
    numbers = np.zeros(4)
    with pytest.raises(TypeError, match="float"):
        lib.ledpi_near_pattern_likelihood(1, 2, *[pointer(numbers)] * 4, 0, 0)
    with pytest.raises(ValueError, match="contiguous"):
        pointer(numbers[::2])
    assert pointer(None) == NONE


def test_what_shows_that_the_sanitizers_see_is_there() -> None:
    """The function that the attack lets read beside an array: where it is gone, CI says so only after half an hour."""
    assert all(hasattr(lib, name) for name in re.findall(r"lib\.(\w+)", READ_BESIDE))
