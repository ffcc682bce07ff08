"""The loops in C: that they are there, that they are these, and that they do as the numpy code they repeat."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from decode_material import LENS, PINHOLE, Canvas, seen_through, square, word
from kernels_material import both_ways, compiled

from ledpi.decode.cells import CellSamples, sample_cells
from ledpi.doctor.machine import loops
from ledpi.geometry import matrix_from_rotation_vector
from ledpi.kernels.library import COMPILED, load
from ledpi.pose.corners import whiteners
from ledpi.pose.planar import solve_squares, square_corners
from ledpi.pose.refine import fit_body
from ledpi.records import Intrinsics, Quad, Rejected

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "ledpi/kernels"


# ---- The build


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
def test_where_there_is_a_compiler_they_are_compiled() -> None:
    """Else all that follows would be skipped without a word: `pip install -e .`, or scripts/test, compiles them."""
    assert COMPILED


@compiled
def test_they_are_used_with_their_own_sources_only(tmp_path: Path) -> None:
    """After an update that was not installed anew, an old library would be given other arguments than it takes."""
    folder = tmp_path / "kernels"
    shutil.copytree(FOLDER, folder)
    assert load(folder) is not None
    with (folder / "light.c").open("a") as source:
        source.write("/* updated */\n")
    assert load(folder) is None


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


# ---- Poses


@compiled
@pytest.mark.parametrize("lens", [PINHOLE, LENS])
def test_poses_of_squares_are_those_of_the_numpy_code(lens: Intrinsics) -> None:
    """Both of each, with their covariances: near and far, face on and oblique, upside down, moving; each by itself."""
    rng = np.random.default_rng(6)
    for number in range(40):
        turn = matrix_from_rotation_vector(rng.normal(size=3) * [0.6, 0.6, 2.0]) @ np.diag([1.0, -1, -1])
        at = turn @ square_corners(0.16).T + np.array([[0.1], [-0.1], [1.0]]) * rng.uniform(0.5, 6)
        corners = seen_through(lens, (at[:2] / at[2]).T * (lens.fx, lens.fy) + (lens.cx, lens.cy))
        corners += rng.normal(0, 0.1, corners.shape)
        motions = rng.normal(0, 4, (1, 4, 2)) if number % 2 else None
        solve = partial(solve_squares, corners[None], np.array([0.1]), np.array([0.08]), [0.16], lens, motions)
        (ours,), (theirs,) = both_ways(solve)
        assert isinstance(ours, tuple)
        assert isinstance(theirs, tuple)
        assert len(ours) == len(theirs)
        for a, b in zip(ours, theirs, strict=True):
            one, other = a.camera_from_marker, b.camera_from_marker
            np.testing.assert_allclose(one.position_m, other.position_m, rtol=1e-6)
            np.testing.assert_allclose(one.quaternion_wxyz, other.quaternion_wxyz, atol=1e-6)
            np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-3, atol=1e-6 * one.covariance.max())
            np.testing.assert_allclose([a.chi2, a.reprojection_px], [b.chi2, b.reprojection_px], rtol=1e-4)


@compiled
@pytest.mark.parametrize("starts", [1, 2, 5])
def test_poses_of_a_body_are_those_of_the_numpy_code(starts: int) -> None:
    """Three squares that hang together, from poses near the true one: in the starts' order, or the likeliest first."""
    rng = np.random.default_rng(starts)
    turn = matrix_from_rotation_vector(np.array([0.2, -0.3, 0.1])) @ np.diag([1.0, -1, -1])
    points = np.concatenate([square_corners(0.16) + shift for shift in ([0, 0, 0], [0.5, 0.1, 0.2], [-0.4, 0.2, 0.1])])
    at = turn @ points.T + np.array([[0.1], [-0.1], [2.0]])
    seen = seen_through(LENS, (at[:2] / at[2]).T * (LENS.fx, LENS.fy) + (LENS.cx, LENS.cy))
    seen += rng.normal(0, 0.1, seen.shape)
    weights = whiteners(seen.reshape(3, 4, 2), np.full(3, 0.1), np.array([0.0, 0.05, 0.09]))
    rotations = np.array([matrix_from_rotation_vector(rng.normal(0, 0.1, 3)) @ turn for _ in range(starts)])
    positions = np.array([0.1, -0.1, 2.0]) + rng.normal(0, 0.05, (starts, 3))
    ours, theirs = both_ways(lambda: fit_body(rotations, positions, points, seen, weights, LENS, at_most=2))
    assert len(ours.chi2) == min(starts, 2)
    np.testing.assert_allclose(ours.positions, theirs.positions, atol=5e-5)  # either ends where no step gains much
    np.testing.assert_allclose(ours.rotations, theirs.rotations, atol=5e-5)
    np.testing.assert_allclose(ours.chi2, theirs.chi2, rtol=1e-3)
    np.testing.assert_allclose(ours.residuals_px, theirs.residuals_px, atol=1e-2)
    np.testing.assert_allclose(ours.covariances, theirs.covariances, rtol=1e-2, atol=1e-3 * theirs.covariances.max())


@compiled
def test_corners_without_a_pose_have_none() -> None:
    """All in one place, in a line, nowhere; between others that have one."""
    corners = np.stack([square(300, 200, 50), np.full((4, 2), 9.0), np.full((4, 2), np.nan), square(100, 200, 50)])
    corners[1, :, 0] = [0, 1, 2, 3]
    found = solve_squares(corners, np.full(4, 0.1), np.zeros(4), [0.16] * 4, PINHOLE)
    assert [isinstance(solutions, Rejected) for solutions in found] == [False, True, True, False]


# ---- Cells


@compiled
@pytest.mark.parametrize("light", [0.2, 0.88])
@pytest.mark.parametrize("lens", [None, LENS])
@pytest.mark.parametrize(("x", "side"), [(82.3, 131), (300, 60), (320, 300), (600.4, 58.2)])
def test_cells_hold_the_light_that_the_numpy_code_finds(
    x: float, side: float, lens: Intrinsics | None, light: float
) -> None:
    """Near and far, at the picture's border, saturated or not; OpenCV rounds places to 1/32 px."""
    corners = square(x, 240, side, 3)
    canvas = Canvas(transfer="linear")
    canvas.panel(corners, word(7), lens=lens, light=light, gains=np.linspace(0.3, 1.1, 16).reshape(4, 4))
    seen = corners if lens is None else seen_through(lens, corners)
    quad = Quad(corners_px=seen, corner_sigma_px=0.1, bend_px=0.0 if lens is None else 1.5)
    ours, theirs = both_ways(partial(sample_cells, canvas.frame(), quad, 4, lens))
    assert isinstance(ours, CellSamples)
    assert isinstance(theirs, CellSamples)
    assert (ours.lattice, ours.cell_px) == (theirs.lattice, theirs.cell_px)
    np.testing.assert_allclose(ours.rows, theirs.rows, atol=1e-3)
    assert ours.independence == theirs.independence
    assert (ours.valid is None) == (theirs.valid is None)
    both = np.ones(ours.light.shape, bool) if ours.valid is None else ours.valid & theirs.valid
    assert both.mean() > 0.97 * (1 if theirs.valid is None else theirs.valid.mean())
    steepest = 0.35 * light  # per pixel, at the panel's rim and its dark walls; in both directions
    assert np.abs(ours.light - theirs.light)[both].max() < 2 * steepest / 64 + 1e-3


@compiled
def test_cells_outside_and_dark_ones_are_refused() -> None:
    """With the same reasons."""
    frame = Canvas(background=0.0).frame(seed=None)
    for corners in (square(20, 240, 50), square(300, 240, 50), square(300, 240, 6), np.full((4, 2), np.nan)):
        quad = Quad(corners_px=corners, corner_sigma_px=0.1)
        ours, theirs = both_ways(partial(sample_cells, frame, quad, 4))
        assert isinstance(ours, Rejected)
        assert ours == theirs
