"""A panel that is followed by its own picture: where it is, how surely, and when a fit is asked again."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from ledpi.core.geometry import box, project_to_quad
from ledpi.core.records import Floats, Frame, Intrinsics, Quad
from ledpi.decode.following import FEWEST_FITS, FOLLOWED, Follower, shares_of
from ledpi.decode.locate import Locator
from ledpi.decode.model.fit import EACH_FIT
from ledpi.decode.model.picture import PanelPicture
from tests.builders.decode import (
    FRAME_ROWS,
    LENS,
    PHASES,
    ROW_TIME_US,
    SPEC,
    Canvas,
    reason,
    seen_through,
    square,
    word,
)

BITS = word(7)
# Cosine and sine of black's wave and of white's, in each cell.
CELL_BANDS = np.where(BITS.reshape(-1, 1), [[0.0, 0.0, 0.01, 0.02]], [[0.02, -0.01, 0.0, 0.0]])
AT = [(0.0, 0.0), (0.3, 0.1), (0.75, 0.45), (1.4, 0.6), (2.1, 1.05), (2.5, 1.3), (3.2, 1.6), (3.9, 2.15)]


def painted(true: Floats, seq: int, *, light: float = 0.4, lens: Intrinsics | None = None) -> Canvas:
    """The panel in the seq-th frame of a stream."""
    canvas, start_us = Canvas(), seq * FRAME_ROWS * ROW_TIME_US
    canvas.panel(true, BITS, light=light, start_us=start_us, phases=PHASES, lens=lens)
    return canvas


def moved(by: tuple[float, float], side: float = 90.0) -> Floats:
    return square(300.4 + by[0], 240.2 + by[1], side, 9.0)


class Stream:
    """One panel: fitted in some frames where it stands, followed by its picture from then on."""

    def __init__(self, true: Floats, *, lens: Intrinsics | None = None) -> None:
        self.locator = Locator(4, (SPEC,), lens)
        self.follower: Follower = self.locator.follower
        fits, near = [], true if lens is None else seen_through(lens, true)
        for seq in range(-FEWEST_FITS, 0):
            frame = painted(true, seq, lens=lens).frame(100 - seq)
            found = self.locator.localise(frame, near)
            assert isinstance(found, Quad), reason(found)
            assert found.unknown is not None
            self.quad: Quad = found
            fits.append(found.unknown)
            picture = self.follower.begin(frame, found, fits, SPEC, CELL_BANDS)
            assert (picture is None) == (len(fits) < FEWEST_FITS)
        assert picture is not None
        self.picture: PanelPicture = picture

    def follow(self, frame: Frame, near: Floats | None = None) -> Quad | None:
        """The panel near where it was."""
        assert self.quad.lattice_px is not None
        followed = self.follower.follow(frame, self.quad.lattice_px if near is None else near, self.picture)
        if followed is None:
            return None
        self.quad, self.picture = followed
        return self.quad


def rms(errors: Sequence[Floats]) -> float:
    """Root of the mean square of corners' distances."""
    return math.sqrt(float(np.mean([np.square(error).sum(axis=1).mean() for error in errors])))


@pytest.mark.slow
@pytest.mark.parametrize("side", [24.0, 200.0])
def test_a_followed_panel_is_where_it_is(side: float) -> None:
    """To a twentieth of a pixel beyond what the fit was off: as a fit would be, at any place between the pixels."""
    stream = Stream(moved((0.0, 0.0), side))
    errors = []
    for seq, by in enumerate(AT[1:], start=1):
        found = stream.follow(painted(moved(by, side), seq).frame(seq))
        assert found is not None
        errors.append(found.corners_px - moved(by, side))
    assert rms(errors) < (0.12 if side < 50 else 0.1 if side < 150 else 0.16)


def test_a_lens_bends_it_as_it_bends_a_fit() -> None:
    """Near a corner of the picture, where the lens moves it by pixels."""
    places = [square(100.3 + 0.7 * k, 90.6 + 0.4 * k, 80.0, 9.0) for k in range(5)]
    stream = Stream(places[0], lens=LENS)
    for seq, true in enumerate(places[1:], start=1):
        found = stream.follow(painted(true, seq, lens=LENS).frame(seq))
        assert found is not None
        assert rms([found.corners_px - seen_through(LENS, true)]) < 0.12


def test_it_costs_a_few_looks() -> None:
    """At each sample of the grid four times, no more than what a fit needs for a step, and the window beside it."""
    stream = Stream(moved((0.0, 0.0)))
    frame, before = painted(moved(AT[1]), 1).frame(1), stream.locator.spent
    assert stream.follow(frame) is not None
    assert 0 < stream.locator.spent - before <= EACH_FIT + 4 * 39**2


def test_frames_make_it_exacter_than_one_fit() -> None:
    """Corners of 16 frames jump half as much from one to the next as those of 16 fits."""
    true = moved((0.0, 0.0), 24.0)
    stream, fits, followed = Stream(true), [], []
    for seq in range(1, 17):
        frame = painted(true, seq).frame(seq)
        found, fit = stream.follow(frame), stream.locator.localise(frame, true)
        assert found is not None
        assert isinstance(fit, Quad)
        followed.append(found.corners_px)
        fits.append(fit.corners_px)
    assert rms(list(np.diff(followed, axis=0))) < 0.5 * rms(list(np.diff(fits, axis=0)))


@pytest.mark.slow
def test_the_stated_deviation_is_no_smaller_than_the_true_one() -> None:
    """Over places, rolls and noise, in the fourth frame: neither a third too small, nor five times too large."""
    rng, squares, stated = np.random.default_rng(4), [], []
    for number in range(8):
        middle, roll = rng.uniform((250, 180), (390, 300)), rng.uniform(-45, 45)
        places = [square(*(middle + 0.6 * k), 40.0, roll) for k in range(4)]
        stream = Stream(places[0])
        for seq, true in enumerate(places[1:], start=1):
            found = stream.follow(painted(true, seq).frame(100 * number + seq))
            assert found is not None
        assert found.covariance_px2 is not None
        order = min((np.roll(found.corners_px, k, axis=0) - places[-1] for k in range(4)), key=lambda e: rms([e]))
        squares.append(np.square(order).mean())
        stated.append(np.trace(found.covariance_px2) / 8)
    assert 0.7 < math.sqrt(np.mean(stated) / np.mean(squares)) < 5.0


@pytest.mark.parametrize(("growth", "asked"), [(1.05, False), (1.09, True), (0.92, True)])
def test_a_fit_is_asked_where_a_panel_has_come_near_or_gone_away(growth: float, asked: bool) -> None:
    """By 7 %, after which its picture would be another."""
    stream, true = Stream(moved((0.0, 0.0))), moved(AT[1], 90.0 * growth)
    assert (stream.follow(painted(true, 1).frame(1), true) is None) == asked


def test_a_fit_is_asked_now_and_then() -> None:
    """After sixteen frames: what it finds of how the panel is built makes the picture better."""
    true = moved((0.0, 0.0))
    stream = Stream(true)
    followed = [stream.follow(painted(true, seq).frame(seq)) is not None for seq in range(1, FOLLOWED + 2)]
    assert followed == FOLLOWED * [True] + [False]


@pytest.mark.parametrize("light", [0.2, 0.45])
def test_its_brightness_may_change(light: float) -> None:
    """As where the gain is adapted: its cells' gains are another's in each frame."""
    stream, true = Stream(moved((0.0, 0.0))), moved(AT[1])
    found = stream.follow(painted(true, 1, light=light).frame(1))
    assert found is not None
    assert rms([found.corners_px - true]) < 0.1


@pytest.mark.parametrize("share", [0.04, 0.3])
def test_a_fit_is_asked_where_something_hides_a_side(share: float) -> None:
    """From a sixth of a cell on: only a fit tells a hidden side from a panel that is shorter."""
    stream, true = Stream(moved((0.0, 0.0))), moved(AT[1])
    canvas = painted(true, 1)
    canvas.lamp(project_to_quad(true, box(-0.5, -0.5, 1.5, share)), light=0.03)
    assert stream.follow(canvas.frame(1)) is None


def test_a_fit_is_asked_where_it_has_gone_elsewhere() -> None:
    """By half a cell, or out of sight; or where another panel of the same size stands."""
    stream, true = Stream(moved((0.0, 0.0))), moved(AT[1])
    frame, other = painted(true, 1).frame(1), Canvas()
    for off_px in (11.0, 150.0, 1e6):
        assert stream.follow(frame, true + off_px) is None
    other.lamp(true)
    assert stream.follow(other.frame(1)) is None


def test_a_fit_is_asked_where_a_part_leaves_the_picture() -> None:
    """A corner by a fifth of the diagonal, and not by 2 px."""
    whole, near, beyond = (square(x, 240.2, 90.0, 45.0) for x in (70.0, 61.6, 38.0))
    stream = Stream(whole)
    assert stream.follow(painted(near, 1).frame(1), near) is not None
    assert stream.follow(painted(beyond, 2).frame(2), beyond) is None


def test_a_panel_with_a_hidden_side_has_no_picture() -> None:
    """It is fitted in each frame, until it is seen whole."""
    true = moved((0.0, 0.0))
    canvas = painted(true, 0)
    canvas.lamp(project_to_quad(true, box(-0.5, -0.5, 1.5, 0.08)), light=0.03)
    locator, frame = Locator(4, (SPEC,), None), canvas.frame(0)
    found = locator.localise(frame, true)
    assert isinstance(found, Quad), reason(found)
    assert found.hidden is not None
    assert found.unknown is not None
    assert locator.follower.begin(frame, found, FEWEST_FITS * [found.unknown], SPEC, CELL_BANDS) is None


def test_what_cells_show_of_each_wave() -> None:
    """Two waves are told apart, and one from its negative; what no cell shows is shown by none."""
    two = np.array([[0.0, 0.0, 0.03, 0.04], [0.02, 0.0, 0.0, 0.0], [0.02, 0.0, 0.0, 0.0]])
    assert shares_of(two).tolist() == [[0.0, 1.0], [1.0, 0.0], [1.0, 0.0]]
    assert shares_of(two[[0, 0]]).tolist() == [[0.0, 1.0], [0.0, 1.0]]
    one = np.array([[0.03, -0.04], [-0.03, 0.04], [0.03, -0.04]])
    assert shares_of(one)[:, 0].tolist() in ([1.0, -1.0, 1.0], [-1.0, 1.0, -1.0])
