"""A glance at candidates: it tells panels from smooth texture, and moves a candidate to where the panel is."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from ledpi.core.geometry import quad_side
from ledpi.core.records import Floats, Pixels
from ledpi.decode.agenda import Agenda, alone
from ledpi.decode.finding.find import Glancer
from ledpi.decode.finding.glance import template
from tests.builders.decode import Canvas, Profile, bare, candidate, diffuser, flat, one_size, square, word

LIKELY = 5.0  # nats: of 150 candidates, texture gets past in one


def look(pixels: Pixels, *candidates: Floats, cells: int = 4, **turn: int) -> tuple[Floats, Floats]:
    """Corners and evidence."""
    pyramid = [pixels]
    for _ in range(3):
        pyramid.append(cv2.resize(pyramid[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    corners, _, evidence = Glancer(cells, 8.0, template(cells)).look(pyramid, [np.stack(candidates)], None, 1.0, **turn)
    return corners.copy(), evidence.copy()


@pytest.mark.parametrize("profile", [flat, diffuser, one_size, bare])
@pytest.mark.parametrize("side", [22, 130])
def test_a_panel_is_likelier_than_texture(side: float, profile: Profile) -> None:
    """At any size, however its cells are lit, from a fifth of a cell beside it."""
    true, canvas = square(310.3, 236.6, side, 20), Canvas()
    canvas.panel(true, word(7), profile=profile)
    _, (evidence,) = look(canvas.frame().pixels, true + 0.05 * side)
    assert evidence > LIKELY


@pytest.mark.parametrize("seed", range(2))
def test_smooth_texture_is_likelier_than_a_panel(seed: int) -> None:
    """Blots about as wide as cells, under a hundred candidates of all sizes."""
    rng = np.random.default_rng(seed)
    blots = cv2.GaussianBlur(rng.standard_normal((480, 640)), (0, 0), 8.0)
    pixels = np.clip(100 + 40 * blots / blots.std(), 0, 255).astype(np.uint8)
    drawn = rng.uniform((90, 90, 24, 0), (550, 390, 120, 90), (100, 4)).tolist()
    there = [square(x, y, side, turn) for x, y, side, turn in drawn]
    _, evidence = look(pixels, *there)
    assert (evidence > LIKELY).sum() <= 1


@pytest.mark.parametrize("off", [(0.3, 0.0), (-0.2, 0.25)])
@pytest.mark.parametrize("side", [40, 110])
def test_a_candidate_is_moved_to_the_panel(side: float, off: tuple[float, float]) -> None:
    """From a third of a cell off, to a tenth."""
    true, canvas = square(310.3, 236.6, side, 12), Canvas()
    canvas.panel(true, word(7), profile=diffuser)
    ((corners,), _) = look(canvas.frame().pixels, true + np.array(off) * side / 4)
    assert np.abs(corners - true).max() < 0.1 * side / 4


def test_candidates_that_lead_to_one_panel_are_one() -> None:
    """They are moved to the same place; the likelier one stays, and comes before texture."""
    true, canvas = square(310.3, 236.6, 90, 12), Canvas()
    canvas.panel(true, word(7))
    corners, evidence = look(canvas.frame().pixels, square(150, 100, 60), true + 6.0, true - 6.0)
    assert np.abs(corners[0] - true).max() < 3.0
    assert evidence[0] == max(evidence)
    assert min(np.abs(other - true).max() for other in corners[1:]) > 3.0


@pytest.mark.parametrize(
    "what", [np.full((4, 2), np.nan), np.full((4, 2), 5.0), square(-400, -400, 90), square(9e3, 9e3, 1e4)]
)
@pytest.mark.parametrize("size", [(480, 640), (3, 5), (1, 1)])
def test_what_is_no_square_in_the_picture_is_no_panel(size: tuple[int, int], what: Floats) -> None:
    """Corners that are no numbers, one point, or out of view; pictures that are too small for any."""
    _, evidence = (
        look(np.random.default_rng(1).integers(0, 256, size, np.uint8), what) if min(size) > 7 else _tiny(size, what)
    )
    assert not (evidence > LIKELY).any()


def _tiny(size: tuple[int, int], what: Floats) -> tuple[Floats, Floats]:
    pixels = np.random.default_rng(1).integers(0, 256, size, np.uint8)
    corners, _, evidence = Glancer(4, 8.0, template(4)).look([pixels], [what[None]], None, 1.0)
    return corners, evidence


@pytest.mark.parametrize("cells", [5, 6, 7])
def test_panels_of_other_dictionaries_have_their_own_template(cells: int) -> None:
    """It has as many cells along a side as they have."""
    true = square(310.3, 236.6, 16.0 * cells, 8)
    canvas = Canvas()
    canvas.panel(true, np.indices((cells, cells)).sum(axis=0) % 2 == 0)
    _, (evidence,) = look(canvas.frame().pixels, true, cells=cells)
    assert evidence > LIKELY


def test_so_many_are_looked_at_at_once_and_the_others_have_their_turn() -> None:
    """No more than three of ten, of all sizes; the largest in the first turn, all in four."""
    sizes = [60.0 - 3 * k for k in range(10)]
    there = [square(60.0 + 55 * k, 200, size) for k, size in enumerate(sizes)]
    shown = np.random.default_rng(1).integers(0, 255, (480, 640)).astype(np.uint8)
    turns = [look(shown, *there, at_once=3, turn=turn)[0] for turn in range(1, 5)]
    assert [len(corners) for corners in turns] == [3, 3, 2, 2]
    assert np.abs(turns[0][0] - there[0]).max() < 15


def test_what_is_unlikely_has_its_turn_in_a_stream() -> None:
    """One in each search, those tried longest ago first; the likely ones come before."""
    likely, *others = (candidate(square(100.0 * k, 100, 50)) for k in range(1, 5))
    others = [each._replace(evidence=-1.0) for each in others]
    agenda, tried = Agenda(), []
    for _ in range(6):
        assert agenda.is_due(())
        first, last = agenda.schedule([likely, *others], is_urgent=False)
        assert quad_side((first.corners_px - likely.corners_px).tolist()) == 0
        agenda.tried(last, in_vain=False)
        tried.append(round(last.corners_px[:, 0].mean() / 100))
    assert tried == [2, 3, 4, 2, 3, 4]


def test_a_frame_by_itself_tries_the_best_of_the_unlikely_last() -> None:
    """The likely ones come in their order, then two of the others, the likelier one first."""
    given = [(1, 3.0), (2, -9.0), (3, 1.0), (4, -2.0), (5, -1.0)]
    candidates = [candidate(square(100.0 * k, 100, 50))._replace(evidence=nats) for k, nats in given]
    assert [one.evidence for one in alone(candidates)] == [3.0, 1.0, -1.0, -2.0]
