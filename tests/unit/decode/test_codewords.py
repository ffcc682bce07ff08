"""The likelihood of codewords and other patterns: held to the equation, pattern by pattern, on panels of few cells."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

from ledpi.core.records import Floats, Singles
from ledpi.decode.evidence.classes import band_shares
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.codewords import (
    likeliest_far_pattern,
    likeliest_part,
    near_pattern_likelihood,
    rank_codewords,
)

CELLS = 9  # an odd number: C takes two at a time
EVERY = np.array(list(itertools.product((0.0, 1.0), repeat=CELLS)), np.float32)  # (512, cells) patterns


def drawn(seed: int, parameters: int, shown: Singles) -> Evidence:
    """Evidence of a pattern (cells,) whose cells are known together, not each by itself."""
    rng = np.random.default_rng(seed)
    size = len(shown) * parameters
    slopes = rng.normal(size=(3 * size, size)) / np.sqrt(3 * size)
    information = 30.0 * (slopes.T @ slopes + 0.3 * np.eye(size))
    bands = band_shares(shown.astype(np.float64), parameters) * rng.normal(0.0, 0.5, parameters)
    score = information @ bands.reshape(-1) + np.linalg.cholesky(information) @ rng.normal(size=size)
    return Evidence(
        score=score.reshape(-1, parameters),
        information=information.reshape(-1, parameters, len(shown), parameters),
        prior=np.full(parameters, 0.3),
    )


def likelihood_of(evidence: Evidence, white: Singles) -> float:
    """Log-likelihood ratio to no bands: ½ bᵀ(A + Λ⁻¹)⁻¹b − ½ ln det(I + ΛA)."""
    shares = band_shares(white.astype(np.float64), len(evidence.prior))
    b = (shares * evidence.score).sum(axis=0)
    a = np.einsum("ci,cidj,dj->ij", shares, evidence.information, shares)
    explained = b @ np.linalg.solve(a + np.diag(1.0 / evidence.prior), b)
    return 0.5 * float(explained - np.linalg.slogdet(np.eye(len(b)) + evidence.prior[:, None] * a)[1])


@pytest.mark.parametrize("parameters", [2, 4])
def test_a_codeword_is_as_likely_as_its_best_bands_and_their_room(parameters: int) -> None:
    """Its bands are those of the equation, too."""
    evidence = drawn(1, parameters, EVERY[0b011010110])
    fit = rank_codewords(evidence, EVERY)
    wanted = [likelihood_of(evidence, EVERY[k]) for k in fit.codewords]
    np.testing.assert_allclose(fit.likelihood, wanted, rtol=1e-9)
    assert fit.likelihood[0] == pytest.approx(max(likelihood_of(evidence, white) for white in EVERY), rel=1e-9)


def log_likelihood(evidence: Evidence, bands: Floats) -> float:
    size = bands.size
    x, information = bands.reshape(-1), evidence.information.reshape(size, size)
    return float(evidence.score.reshape(-1) @ x - 0.5 * x @ information @ x)


@pytest.mark.parametrize("parameters", [2, 4])
def test_a_cell_s_gain_is_that_of_the_other_class_in_it(parameters: int) -> None:
    """Under the codeword's bands; and what all patterns beyond it have together is the sum over every one of them."""
    evidence = drawn(2, parameters, EVERY[0b101100011])
    fit = rank_codewords(evidence, EVERY)
    white = EVERY[fit.codewords[0]].astype(np.float64)
    for cell in range(CELLS):
        other = white.copy()
        other[cell] = 1.0 - other[cell]
        turned = band_shares(other, parameters) * fit.bands
        assert fit.gain[cell] == pytest.approx(
            log_likelihood(evidence, turned) - log_likelihood(evidence, fit.cell_bands)
        )
    of_flips = [(int(flips.sum()), float(np.exp(flips @ np.array(fit.gain)))) for flips in EVERY]
    any_other, several = (np.log(sum(ratio for count, ratio in of_flips if count >= least)) for least in (1, 2))
    assert fit.beyond == [pytest.approx(any_other), pytest.approx(several)]


@pytest.mark.parametrize("parameters", [2, 4])
@pytest.mark.parametrize("seed", range(4))
def test_near_patterns_are_summed_and_the_likeliest_far_one_is_found(seed: int, parameters: int) -> None:
    """As if every pattern were tried: those that are left out add a hundredth of a nat at most."""
    shown = EVERY[np.random.default_rng(seed).integers(len(EVERY))]
    evidence = drawn(seed, parameters, shown)
    off = np.abs(EVERY - shown).sum(axis=1)
    likely = np.array([likelihood_of(evidence, white) for white in EVERY])
    near = (off >= 1) & (off <= 3)
    assert near_pattern_likelihood(evidence, shown, 1, 3) == pytest.approx(np.logaddexp.reduce(likely[near]), abs=0.01)
    nats, pattern = likeliest_far_pattern(evidence, shown, 1)
    far = off if parameters == 4 else np.minimum(off, CELLS - off)  # in antiphase the other way round is the same
    assert nats == pytest.approx(likely[far > 1].max())
    assert likelihood_of(evidence, pattern) == pytest.approx(nats)


@pytest.mark.parametrize("turn", [0.0, 0.3, 0.5, 0.8])
def test_a_pattern_that_differs_in_most_cells_is_found_in_any_phase(turn: float) -> None:
    """A climb from the codeword does not reach it: the phases' grid begins where it is."""
    shown = np.array([1, 0, 0, 1, 1, 1, 0, 0, 1, 0, 1, 0, 0, 1, 1, 0], np.float32)
    wave = 0.5 * np.array([np.cos(np.pi * turn), np.sin(np.pi * turn)])
    bands = band_shares(shown.astype(np.float64), 4) * np.concatenate([wave, wave[::-1]])
    information = np.zeros((16, 4, 16, 4))
    information[np.arange(16), :, np.arange(16), :] = 40.0 * np.eye(4)
    evidence = Evidence(score=40.0 * bands, information=information, prior=np.full(4, 0.3))
    codeword = 1.0 - shown
    codeword[:3] = shown[:3]
    np.testing.assert_array_equal(likeliest_far_pattern(evidence, codeword, 1)[1], shown)


HALVES = {1: [[1.0]] * 3, 2: [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]], 3: [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]}


@pytest.mark.parametrize("parameters", [2, 4])
@pytest.mark.parametrize("own", range(3))
def test_the_likeliest_part_is_that_of_all_blocks_of_codewords(own: int, parameters: int) -> None:
    """The middle row of three shows half of either row of a part of two. None shows the codeword itself."""
    codewords = EVERY[[0b101100011, 0b110110000, 0b111111000]]
    evidence, best = drawn(4, parameters, EVERY[0b110011001]), -np.inf
    for rows, columns in itertools.product((1, 2, 3), repeat=2):
        if rows * columns == CELLS:
            continue
        windows = sliding_window_view(codewords.reshape(3, 3, 3), (rows, columns), (1, 2)).reshape(-1, rows * columns)
        shown = np.unique(windows, axis=0) @ np.kron(HALVES[rows], HALVES[columns]).T
        each = [likelihood_of(evidence, light) for light in shown if not np.array_equal(light, codewords[own])]
        best = max(best, max(each) - np.log(len(each)))
    assert likeliest_part(evidence, codewords, own, -np.inf) == pytest.approx(best, rel=1e-9)
    assert likeliest_part(evidence, codewords, own, best - 1.0) == pytest.approx(best, rel=1e-9)
    assert likeliest_part(evidence, codewords, own, 1e6) == -np.inf
