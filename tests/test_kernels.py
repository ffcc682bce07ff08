"""The core: that it is there, that it is this one; and that what refines squares does as the numpy code it repeats."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from decode_material import LENS, Canvas, seen_through, square, word
from kernels_material import both_ways, compiled

from ledpi.decode.corners.approach import _approach_quads, approach_quads
from ledpi.decode.corners.edges import NOT_WHOLE, refine_quads
from ledpi.decode.corners.sides import Patches, as_points, bends
from ledpi.errors import InstallationError
from ledpi.kernels.library import NONE, at, check, lib
from ledpi.records import Floats, Frame, Intrinsics, Quad, Rejected, Transfer

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "ledpi/kernels"

# Older OpenCVs round places between pixels to this, which the loops do not.
ROUNDED_PX = 0.0 if cv2.__version__.startswith("5") else 1 / 64


# ---- The build


def test_the_core_is_of_its_own_sources(tmp_path: Path) -> None:
    """After an update that was not installed anew an old core does what older sources say; the error has a remedy."""
    folder = tmp_path / "kernels"
    shutil.copytree(FOLDER, folder)
    check(folder)
    with (folder / "light.c").open("a") as source:
        source.write("/* updated */\n")
    with pytest.raises(InstallationError, match=r"other sources than .*kernels; install ledpi again: .*gcc"):
        check(folder)


def test_without_a_core_the_remedy_is_said() -> None:
    """In one line, by whatever needs it first."""
    code = "import sys; sys.modules['ledpi.kernels._core'] = None; import ledpi.decode.cells"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "InstallationError: ledpi's compiled core is not there" in done.stderr.splitlines()[-1]


def test_without_a_compiler_the_installation_fails(tmp_path: Path) -> None:
    """Instead of one that cannot read a panel."""
    pytest.importorskip("cffi")
    for name in ("setup.py", "build_core.py"):
        shutil.copy(ROOT / name, tmp_path)
    shutil.copytree(FOLDER, tmp_path / "ledpi/kernels", ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    command = [sys.executable, "setup.py", "build_ext", "--inplace"]
    environment = {**os.environ, "CC": str(tmp_path / "no-such-compiler")}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "no-such-compiler" in done.stdout + done.stderr


def test_arrays_are_handed_over_by_their_type() -> None:
    """One of another type, or with gaps, is refused before C sees it."""
    numbers = np.zeros(4)
    with pytest.raises(TypeError, match="float"):
        lib.ledpi_waves(at(numbers), 4, 0.1, 0.0, at(numbers), at(numbers))
    with pytest.raises(ValueError, match="contiguous"):
        at(numbers[::2])
    assert at(None) == NONE


# ---- Light


def frame_of(pixels: np.ndarray, transfer: str = "linear") -> Frame:
    return Frame(pixels=pixels, seq=0, row0_readout_ns=0, exposure_us=1e4, row_time_us=30.0, transfer=transfer)


def light_at(frame: Frame, points: np.ndarray) -> np.ndarray:
    """Around the points themselves."""
    corners = np.array([[0, 59, 59 + 39j, 39j]])
    patches = Patches(frame, corners, 9.0)
    return patches.light_at((points - patches.first).astype(np.complex64))


@compiled
def test_light_between_pixels() -> None:
    """A quarter of the way to the right, half of the way down; beyond the picture as at its border."""
    points = np.array([[0.25 + 0.5j, 1, -3 - 3j, 7 + 9j, 1j]])
    frame = frame_of(np.array([[0, 51], [102, 153]], np.uint8))
    np.testing.assert_allclose(light_at(frame, points), [[0.25 * 0.2 + 0.5 * 0.4, 0.2, 0.0, 0.6, 0.4]], atol=1e-6)


@compiled
@pytest.mark.parametrize("transfer", ["linear", "srgb"])
def test_light_is_what_opencv_interpolates(transfer: str) -> None:
    """Anywhere in and around a picture."""
    rng = np.random.default_rng(1)
    frame = frame_of(rng.integers(0, 255, (40, 60), np.uint8), transfer)
    points = rng.uniform(-9, 69, (1, 900)) + 1j * rng.uniform(-9, 49, (1, 900))
    ours, theirs = both_ways(lambda: light_at(frame, points))
    steepest = 1.0  # of the light from one pixel to the next
    assert np.abs(ours - theirs).max() <= 2 * steepest * ROUNDED_PX + 1e-5


@compiled
def test_places_that_are_no_numbers_do_no_harm() -> None:
    """Degenerate quads ask for light at infinity and at nothing."""
    points = np.array([[np.nan, np.inf, -np.inf, 1e38, complex(1, np.nan), complex(np.inf, -np.inf)]], np.complex64)
    frame = frame_of(np.full((4, 4), 51, np.uint8))
    np.testing.assert_allclose(Patches(frame, np.zeros((1, 4)) + 0j, 8.0).light_at(points), 0.2, rtol=1e-6)


# ---- Edges


@compiled
def test_lenses_bend_sides_as_in_the_numpy_code() -> None:
    """Anywhere in the picture."""
    rng = np.random.default_rng(9)
    corners = as_points(np.stack([square(*rng.uniform(50, 430, 2), rng.uniform(10, 200), 30) for _ in range(6)]))
    ours, theirs = both_ways(partial(bends, corners, LENS))
    np.testing.assert_allclose(ours, theirs, atol=1e-9)


def panels(transfer: Transfer = "srgb", lens: Intrinsics | None = None) -> tuple[Frame, Floats]:
    """A panel large, small, oblique, far; one that the picture cuts off, a lamp with bad sides, and a bare wall."""
    oblique = np.array([[420.0, 60], [500, 95], [500, 200], [420, 240]])
    places = [square(120.3, 130.2, 160, 7), square(300.4, 100.7, 60, -20), oblique, square(330, 330, 14, 40)]
    canvas = Canvas(transfer=transfer)
    for place in places:
        canvas.panel(place, word(7), lens=lens)
    canvas.panel(square(5, 440, 60), word(23), lens=lens)
    canvas.disc(560, 380, 30)
    places += [square(5, 440, 60), square(560, 380, 52), square(220, 420, 50)]
    seen = places if lens is None else [seen_through(lens, place) for place in places]
    return canvas.frame(seed=4), np.stack(seen)


def assert_same(ours: Sequence[Quad | Rejected], theirs: Sequence[Quad | Rejected], within_px: float) -> None:
    assert len(ours) == len(theirs)
    for a, b in zip(ours, theirs, strict=True):
        if isinstance(a, Rejected) or isinstance(b, Rejected):
            assert isinstance(a, Rejected) == isinstance(b, Rejected)
        else:
            np.testing.assert_allclose(a.corners_px, b.corners_px, atol=within_px)
            assert (a.seen_px is None) == (b.seen_px is None)
            np.testing.assert_allclose(a.corner_sigma_px, b.corner_sigma_px, rtol=0.02, atol=within_px / 10)
            np.testing.assert_allclose(a.size_sigma_px, b.size_sigma_px, rtol=0.02, atol=within_px / 10)
            np.testing.assert_allclose(a.bend_px, b.bend_px, atol=1e-6)
            np.testing.assert_allclose(a.rim_wall, b.rim_wall, atol=1e-4)
            assert a.cells_show == b.cells_show


@compiled
@pytest.mark.parametrize("off_px", [0.1, 1.0, 2.5])
@pytest.mark.parametrize(("transfer", "lens"), [("srgb", None), ("linear", LENS)])
def test_edges_are_those_of_the_numpy_code(off_px: float, transfer: Transfer, lens: Intrinsics | None) -> None:
    """From corners that are right, off as after a search, and too far off for the filters; all at once."""
    frame, places = panels(transfer, lens)
    near = places + np.random.default_rng(2).uniform(-off_px, off_px, places.shape)
    ours, theirs = both_ways(lambda: refine_quads(frame, near, 4, lens))
    assert sum(isinstance(quad, Quad) for quad in ours) >= 3
    assert_same(ours, theirs, within_px=1e-4 + 2 * ROUNDED_PX)


@compiled
@pytest.mark.parametrize("side", [90, 200])
def test_a_rim_without_walls_is_as_by_the_numpy_code(side: float) -> None:
    """A tenth of a cell between cells of one size, and nothing around them."""

    def apart(u: Floats, v: Floats) -> Floats:
        return np.where(np.maximum(3.9 * u % 1, 3.9 * v % 1) < 0.9, 1.0, 0.0)

    true, canvas = square(310.4, 240.2, side, 8), Canvas()
    canvas.panel(true, word(7), profile=apart)
    frame = canvas.frame()
    ours, theirs = both_ways(lambda: refine_quads(frame, true[None], 4))
    assert_same(ours, theirs, within_px=1e-3 + 2 * ROUNDED_PX)
    assert isinstance(ours[0], Quad)
    assert ours[0].rim_wall > 0


@compiled
@pytest.mark.parametrize("tolerance_px", [3.0, 8.0])
def test_rough_squares_are_approached_as_by_the_numpy_code(tolerance_px: float) -> None:
    """From corners off by half of that, and one with a corner cut off; by the same light, which numpy takes roughly."""
    frame, places = panels()
    off = np.random.default_rng(3).uniform(-0.5, 0.5, places.shape)
    rough = np.concatenate([places, places[:1]]) + tolerance_px * np.concatenate([off, off[:1]])
    rough[-1, 1] += 0.2 * (places[0, 3] - places[0, 1])
    tolerance = np.full(len(rough), tolerance_px)
    ours, theirs = approach_quads(frame, rough, tolerance), _approach_quads(frame, rough, tolerance)
    assert sum(not isinstance(at, Rejected) for at in ours) >= 4
    for a, b in zip(ours, theirs, strict=True):
        if isinstance(a, Rejected) or isinstance(b, Rejected):
            assert a == b
        else:
            np.testing.assert_allclose(a, b, atol=1e-3)


@compiled
def test_quads_that_are_none_are_refused_as_by_the_numpy_code() -> None:
    """Without an area, folded, or nowhere near the picture; and none at all."""
    frame, places = panels()
    point, line = np.full((4, 2), 100.0), np.array([[50.0, 50], [90, 50], [90, 50], [50, 50]])
    folded, far = places[0][[0, 2, 1, 3]], places[0] + 1e4
    near = np.stack([point, line, folded, far, -far])
    for quads in (near, near[:0]):
        ours, theirs = both_ways(partial(refine_quads, frame, quads, 4, LENS))
        assert_same(ours, theirs, within_px=1e-3)


@compiled
def test_quads_that_are_not_finite_are_refused() -> None:
    """No index comes of them, and no warning."""
    frame, places = panels()
    near = np.stack([np.full((4, 2), np.nan), places[0] * [np.inf, 1], places[0] + 1e30])
    assert all(isinstance(quad, Rejected) for quad in refine_quads(frame, near, 4))


@compiled
@pytest.mark.parametrize("cells", [2, 4, 5])
def test_edges_with_other_cells_are_those_of_the_numpy_code(cells: int) -> None:
    """Where lines between cells are too few to adjust by, and where cells are not those that are asked for."""
    frame, places = panels()
    ours, theirs = both_ways(lambda: refine_quads(frame, places, cells))
    assert_same(ours, theirs, within_px=1e-4 + 2 * ROUNDED_PX)


@compiled
def test_what_is_hidden_is_what_the_numpy_code_finds() -> None:
    """Of a whole panel nothing; of one with a hidden side, that; and of one without its first row, no place is told."""
    places = [square(150, 150, 90, 10), square(400, 150, 90, -5), square(250, 350, 120)]
    canvas, dead = Canvas(), np.ones((4, 4))
    dead[0] = 0.0
    for place, gains in zip(places, (None, None, dead), strict=True):
        canvas.panel(place, word(7), gains=gains)
    seen = np.stack(places)
    seen[1, [0, 3]] += 0.1 * (seen[1, [1, 2]] - seen[1, [0, 3]])
    seen[2, [0, 1]] += 0.25 * (seen[2, [3, 2]] - seen[2, [0, 1]])
    outward = 0.3 * (places[1] - places[1][[1, 0, 3, 2]])
    canvas.lamp(np.array([places[1][0] + outward[0], seen[1, 0], seen[1, 3], places[1][3] + outward[3]]), 0.0)
    ours, theirs = both_ways(lambda: refine_quads(canvas.frame(), seen, 4, LENS))
    assert_same(ours, theirs, within_px=1e-3 + 2 * ROUNDED_PX)
    whole, hidden, without_row = ours
    assert isinstance(whole, Quad)
    assert isinstance(hidden, Quad)
    assert whole.seen_px is None
    np.testing.assert_allclose(hidden.seen_px, seen[1], atol=0.3)
    np.testing.assert_allclose(hidden.corners_px, places[1], atol=1.5)
    assert without_row == NOT_WHOLE
