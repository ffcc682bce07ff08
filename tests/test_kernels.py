"""The loops in C: that they are there, that they are these, and that they do as the numpy code they repeat."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ledpi.decode.sides import Patches
from ledpi.doctor.machine import loops
from ledpi.kernels.library import COMPILED, sources
from ledpi.records import Frame

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "ledpi/kernels"

compiled = pytest.mark.skipif(not COMPILED, reason="needs the compiled loops (a C compiler when ledpi was installed)")


# ---- The build


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
def test_where_there_is_a_compiler_they_are_compiled() -> None:
    """Else all that follows would be skipped without a word: `pip install -e .`, or scripts/test, compiles them."""
    assert COMPILED


@compiled
def test_they_are_of_these_sources() -> None:
    """A library that is older than its sources would be tested in their place."""
    files = [*sorted(FOLDER.glob("*.c")), *sorted(FOLDER.glob("*.h"))]
    assert sources() == hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


def test_without_a_compiler_the_installation_succeeds(tmp_path: Path) -> None:
    """Then nothing is compiled, and nothing is broken."""
    pytest.importorskip("setuptools")
    shutil.copy(ROOT / "setup.py", tmp_path)
    shutil.copytree(FOLDER, tmp_path / "ledpi/kernels", ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    command = [sys.executable, "setup.py", "build_ext", "--inplace"]
    environment = {**os.environ, "CC": str(tmp_path / "no-such-compiler")}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not list(tmp_path.rglob("*.so"))


def test_the_doctor_says_whether_they_are() -> None:
    """Where they are not, with a remedy, and the daemon runs all the same."""
    found = loops()
    assert (found.state == "ok") == COMPILED
    assert bool(found.remedy) != COMPILED
    assert not found.stops_daemon


# ---- Light


def frame_of(pixels: np.ndarray, transfer: str = "linear") -> Frame:
    return Frame(pixels=pixels, seq=0, row0_readout_ns=0, exposure_us=1e4, row_time_us=30.0, transfer=transfer)


@compiled
def test_light_between_pixels() -> None:
    """A quarter of the way to the right, half of the way down; beyond the picture as at its border."""
    frame = frame_of(np.array([[0, 51], [102, 153]], np.uint8))
    patches = Patches(frame, np.zeros((1, 4), np.complex128), 8.0, compiled=True)
    points = np.array([[0.25 + 0.5j, 1, -3 - 3j, 7 + 9j, 1j]], np.complex64)
    expected = [[0.25 * 0.2 + 0.5 * 0.4, 0.2, 0.0, 0.6, 0.4]]
    np.testing.assert_allclose(patches.light_at(points), expected, atol=1e-6)


@compiled
def test_light_is_what_opencv_interpolates() -> None:
    """Anywhere in and around a picture; older OpenCVs round places to 1/32 of a pixel."""
    rng = np.random.default_rng(1)
    pixels = rng.integers(0, 255, (40, 60), np.uint8)
    points = (rng.uniform(-9, 69, (2, 500)) + 1j * rng.uniform(-9, 49, (2, 500))).astype(np.complex64)
    corners = np.tile(np.array([0, 59, 59 + 39j, 39j]), (2, 1))
    for transfer in ("linear", "srgb"):
        frame = frame_of(pixels, transfer)
        ours, theirs = (
            patches.light_at(points - patches.first.astype(np.complex64))
            for patches in (Patches(frame, corners, 9.0, compiled=use) for use in (True, False))
        )
        steps = np.abs(np.diff(theirs)).max()
        assert np.abs(ours - theirs).max() <= 2 * steps / 64


@compiled
def test_places_that_are_no_numbers_do_no_harm() -> None:
    """Degenerate quads ask for light at infinity and at nothing."""
    patches = Patches(frame_of(np.full((4, 4), 51, np.uint8)), np.zeros((1, 4), np.complex128), 8.0, compiled=True)
    points = np.array([[np.nan, np.inf, -np.inf, 1e38, complex(1, np.nan), complex(np.inf, -np.inf)]], np.complex64)
    np.testing.assert_allclose(patches.light_at(points), 0.2, rtol=1e-6)
