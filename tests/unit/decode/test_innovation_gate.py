"""A frame denies or confirms the bands that its track has shown: by hand, of cells that are weighed alone."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
import pytest

from ledpi.core.records import Floats, Mask
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.innovation_gate import confirms, contradicts, enough_to_confirm

DEPTH = 0.5
WHITE = np.arange(16) % 2 == 1


def bands(white: Mask) -> Floats:
    """(16, 4) of cells of these classes: cosine and sine of black's wave and of white's."""
    shown = np.zeros((16, 4))
    shown[np.arange(16), np.where(white, 2, 0)] = DEPTH
    return shown


def frame_with(shown: Floats, information: float) -> Evidence:
    """Evidence that a frame with these bands adds, without noise; cosines and sines are known by this `information`."""
    everywhere = information * np.eye(64).reshape(16, 4, 16, 4)
    return Evidence(score=information * shown, information=everywhere, prior=np.ones(4))


@pytest.mark.parametrize("information", [0.1, 1000.0])
def test_a_frame_with_the_same_bands_denies_nothing(information: float) -> None:
    """However much or little it tells."""
    assert not contradicts(frame_with(bands(WHITE), information), bands(WHITE))


@pytest.mark.parametrize(("information", "denied"), [(2.4, False), (2.6, True)])
def test_a_frame_without_bands_denies_them_by_five_nats(information: float, denied: bool) -> None:
    """In 16 cells it is likelier without them by 16 · ½ · 0.5² · information."""
    assert contradicts(frame_with(np.zeros((16, 4)), information), bands(WHITE)) is denied


@pytest.mark.parametrize(("swapped", "denied"), [(2, False), (3, True)])
def test_a_frame_with_bands_in_other_cells_denies_them_by_sixteen_nats(swapped: int, denied: bool) -> None:
    """And by a sixteenth of what all of them show, 16 · ½ · 0.5² · 40 = 80: by how far cells' bands differ.

    Each cell that is of the other class would be so by ½ · 2 · 0.5² · 40 = 10; the rest are as they were.
    """
    assert contradicts(frame_with(bands(WHITE ^ (np.arange(16) < swapped)), 40.0), bands(WHITE)) is denied


def test_a_frame_that_adds_nothing_denies_nothing() -> None:
    """As the first of a track, which is compared with none."""
    assert not contradicts(None, bands(WHITE))


@pytest.mark.parametrize(("information", "confirmed"), [(2.4, False), (2.6, True)])
def test_a_frame_with_the_same_bands_confirms_them_by_five_nats(information: float, confirmed: bool) -> None:
    """In 16 cells it is likelier with them by 16 · ½ · 0.5² · information."""
    assert confirms(frame_with(bands(WHITE), information), bands(WHITE)) is confirmed


@pytest.mark.parametrize("information", [10.0, 1000.0])
@pytest.mark.parametrize("swapped", [4, 8])
def test_a_frame_with_bands_in_other_cells_confirms_nothing(swapped: int, information: float) -> None:
    """A word may share three quarters of its cells with another: it is likelier than no bands, and yet not shown."""
    frame = frame_with(bands(WHITE ^ (np.arange(16) < swapped)), information)
    assert not confirms(frame, bands(WHITE))


@pytest.mark.parametrize("cells", [16, 36])
def test_so_much_confirms_a_panel_but_once_in_a_thousand(cells: int) -> None:
    """A ratio of mean E and variance 2E, by hand: less than what unchanged cells ask for in one frame of a thousand."""
    enough = enough_to_confirm(cells)
    asked = 5.0 + 4.0 * 0.2 * cells
    assert NormalDist(enough, math.sqrt(2.0 * enough)).cdf(asked) == pytest.approx(1e-3, rel=0.05)


def test_a_frame_that_says_nothing_by_itself_confirms_nothing() -> None:
    """As one of deep bands, which more than one look tells."""
    assert not confirms(None, bands(WHITE))
