"""The core weighs a panel's cells: held to the equations, written once in numpy, and to the waves themselves."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from ledpi.core.records import Frame, PanelSpec
from ledpi.decode.evidence.band_estimate import BandEstimate, estimate_bands
from ledpi.decode.evidence.cells import CellSamples
from ledpi.decode.evidence.classes import band_shares
from ledpi.decode.evidence.evidence import UNFIT, Evidence
from ledpi.decode.evidence.single_frame import single_evidence
from ledpi.decode.evidence.waves import class_waves
from ledpi.decode.identify import codewords
from ledpi.decode.identify.codebook import Codebook
from ledpi.markers.dictionaries import load_dictionary
from tests.builders import evidence_reference as reference
from tests.builders.decode import SPEC, TRUE_10_MS_US, Canvas, diffuser, square, word
from tests.builders.evidence_reference import word_log_likelihoods
from tests.builders.samples import samples_of

ANTIPHASE = dataclasses.replace(SPEC, white_hz=SPEC.black_hz, phase="antiphase")
EXPOSURE_US = {"shallow": TRUE_10_MS_US, "deep": 151.5}


def seen(side: float, exposure_us: float = TRUE_10_MS_US) -> tuple[CellSamples, Frame]:
    """A painted panel whose side is so many pixels."""
    corners = square(310.3, 240.6, side, 9)
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(corners, word(7), profile=diffuser)
    frame = canvas.frame(seed=1)
    samples = samples_of(frame, corners)
    return samples, frame


def with_holes(samples: CellSamples) -> CellSamples:
    """As if a tenth of the samples were saturated, and one point in all cells."""
    valid = np.random.default_rng(2).random(samples.light.shape) > 0.1
    valid[:, 5] = False
    return dataclasses.replace(samples, valid=valid, light=samples.light * valid)


def believed_of(samples: CellSamples, frame: Frame, spec: PanelSpec = SPEC) -> BandEstimate:
    bands = np.array([0.5, 0.1, 0.3, -0.2][: 2 * len(spec.waves_hz)])
    return estimate_bands(samples, frame, spec, word(7).ravel(), bands)


def assert_alike(
    samples: CellSamples,
    frame: Frame,
    estimate: BandEstimate | None = None,
    spec: PanelSpec = SPEC,
    noise_within: float = 1e-2,
) -> None:
    """But for the noise, by which all is weighed: that is what is left of the light, the small rest of large sums."""
    waves = class_waves(samples, frame, spec) if estimate is None else estimate.waves
    evidence = single_evidence(samples, frame, spec, estimate)
    assert isinstance(evidence, Evidence)
    if estimate is not None:  # evidence is on the bands, the reference's on how far they differ from the estimate
        of_estimate = np.einsum("cidj,dj->ci", evidence.information, estimate.bands)
        evidence = evidence._replace(score=evidence.score - of_estimate)
    score, information = reference.single_frame_evidence(samples, waves, estimate)
    weight = float(np.einsum("cici->", evidence.information)) / float(np.trace(information))
    assert weight == pytest.approx(1.0, abs=noise_within)
    for mine, theirs in ((evidence.score, score), (evidence.information, information)):
        np.testing.assert_allclose(mine.ravel(), weight * theirs.ravel(), atol=2e-3 * float(np.abs(theirs).max()))


@pytest.mark.parametrize("side", [14.0, 40.0, 90.0, 200.0], ids=lambda side: f"{side:.0f} px")
def test_the_evidence_of_a_picture(side: float) -> None:
    """At any size: with many neighbours' light at each point, and with little."""
    assert_alike(*seen(side), noise_within=0.1 if side < 20 else 1e-2)


@pytest.mark.parametrize("depth", EXPOSURE_US)
def test_the_evidence_of_a_second_look(depth: str) -> None:
    """The bands are known already, and hide or show what is static."""
    samples, frame = seen(90.0, EXPOSURE_US[depth])
    assert_alike(samples, frame, believed_of(samples, frame))


def test_the_evidence_of_one_wave() -> None:
    """That both classes of an antiphase panel show."""
    samples, frame = seen(60.0)
    assert_alike(samples, frame, None, ANTIPHASE)
    assert_alike(samples, frame, believed_of(samples, frame, ANTIPHASE), ANTIPHASE)


def test_the_evidence_of_a_picture_with_holes() -> None:
    """Saturated samples are filled in, in the first look and in the second."""
    samples, frame = seen(60.0)
    holes = with_holes(samples)
    assert_alike(holes, frame)
    assert_alike(holes, frame, believed_of(holes, frame))


def test_light_that_is_no_number_is_no_evidence() -> None:
    """Nothing that is computed from it passes for one."""
    samples, frame = seen(40.0)
    light = samples.light.copy()
    light[3, 4] = np.nan
    assert single_evidence(dataclasses.replace(samples, light=light), frame, SPEC) == UNFIT


def test_waves_are_cosine_and_sine() -> None:
    """Black's come first, then white's, from row 0 on."""
    samples, frame = seen(40.0)
    seconds = samples.rows.astype(np.float64) * frame.row_time_us * 1e-6
    turns = 2 * np.pi * np.array([SPEC.black_hz, SPEC.white_hz])[:, None, None] * seconds
    expected = np.stack([np.cos(turns[0]), np.sin(turns[0]), np.cos(turns[1]), np.sin(turns[1])])
    waves = class_waves(samples, frame, SPEC)
    np.testing.assert_allclose(waves, expected, atol=5e-4)  # rows are in single precision
    holes = with_holes(samples)
    assert not class_waves(holes, frame, SPEC)[:, ~holes.valid].any()


@pytest.mark.parametrize("spec", [SPEC, ANTIPHASE], ids=["two waves", "one wave"])
def test_the_likeliest_words(spec: PanelSpec) -> None:
    """Which they are, in their order, how likely; the best one's bands, and what speaks against it."""
    samples, frame = seen(60.0)
    evidence = single_evidence(samples, frame, spec)
    assert isinstance(evidence, Evidence)
    white = Codebook.build(list(range(50)), load_dictionary("DICT_4X4_50"), spec).white
    likelihood, bands, covariance = word_log_likelihoods(evidence, white)
    order = np.argsort(-likelihood)
    fit, best = codewords.rank_codewords(evidence, white), order[0]
    assert fit.codewords[:4] == order[:4].tolist()  # they are put on the list by what each cell tells by itself
    assert len(fit.codewords) == codewords.SHORTLIST
    np.testing.assert_allclose(fit.likelihood, likelihood[fit.codewords], rtol=1e-6)
    assert fit.likelihood == sorted(fit.likelihood, reverse=True)
    np.testing.assert_allclose(fit.bands, bands[best], rtol=1e-6)
    np.testing.assert_allclose(fit.deviation, np.sqrt(np.diagonal(covariance[best])), rtol=1e-6)
    np.testing.assert_allclose(
        fit.cell_bands, band_shares(white[best].astype(np.float64), bands.shape[1]) * bands[best]
    )
    others = np.stack([1 - white[best], np.zeros(16), np.ones(16)])
    negative, *of_one = word_log_likelihoods(evidence, others)[0]
    assert (fit.negative, fit.single_class) == pytest.approx((negative, max(of_one)), rel=1e-6)
    size = evidence.score.size
    information, score = evidence.information.reshape(size, size), evidence.score.reshape(size)
    assert fit.of_cells == pytest.approx(0.5 * score @ np.linalg.solve(information, score), rel=1e-2)
    assert fit.erased is None


def test_what_a_cell_gains_by_the_other_class() -> None:
    """The difference of the quadratic's two values; and of the weakest row, of its cells with their bands and none."""
    samples, frame = seen(60.0)
    evidence = single_evidence(samples, frame, SPEC)
    assert isinstance(evidence, Evidence)
    fit = codewords.rank_codewords(evidence, Codebook.build([7], load_dictionary("DICT_4X4_50"), SPEC).white)

    def log_likelihood(shown: np.ndarray) -> float:
        return float((evidence.score * shown).sum() - 0.5 * np.einsum("ci,cidj,dj", shown, evidence.information, shown))

    def changed(cell: int, bands: np.ndarray) -> np.ndarray:
        return np.where(np.arange(16)[:, None] == cell, bands, fit.cell_bands)

    own = log_likelihood(fit.cell_bands)
    others = [changed(cell, fit.bands - fit.cell_bands[cell]) for cell in range(16)]
    gain = [log_likelihood(shown) - own for shown in others]
    np.testing.assert_allclose(fit.gain, gain, rtol=1e-6)
    np.testing.assert_allclose(codewords.class_flip_gain(evidence, fit.cell_bands), gain, rtol=1e-6)
    blinks = np.array([own - log_likelihood(changed(cell, np.zeros(4))) for cell in range(16)]).reshape(4, 4)
    weakest = min(blinks.sum(axis=0).min(), blinks.sum(axis=1).min())
    assert fit.weakest_row == pytest.approx(weakest, rel=1e-6)


@pytest.mark.parametrize("scale", [10.0, 0.01], ids=["surely", "hardly"])
def test_codewords_beside_erased_cells(scale: float) -> None:
    """Which cells are erased, and the patterns of the others: of likelihoods too small for a number, too."""
    samples, frame = seen(200.0)
    whole = single_evidence(samples, frame, SPEC)
    assert isinstance(whole, Evidence)
    score, information = scale * whole.score, scale * whole.information
    for cell in (3, 9):
        score[cell] = information[cell] = information[:, :, cell] = 0.0
    evidence = whole._replace(score=score, information=information)
    book = Codebook.build(list(range(50)), load_dictionary("DICT_4X4_50"), SPEC)
    fit = codewords.rank_codewords(evidence, book.white)
    assert fit.erased is not None
    assert np.flatnonzero(fit.erased).tolist() == [3, 9]
    gain = [own for cell, own in enumerate(fit.gain) if cell not in (3, 9)]
    # One cell or more, and two or more, of independent ones: the product of 1 + ratio, less the first terms.
    if scale < 1:
        ratios = np.exp(gain)
        all_of = np.prod(1 + ratios)
        assert fit.beyond == pytest.approx(np.log([all_of - 1, all_of - 1 - ratios.sum()]), rel=1e-6)
    else:
        assert fit.beyond[1] == pytest.approx(sum(sorted(gain)[-2:]))
        assert fit.beyond[1] < -600


def test_a_short_list_of_words() -> None:
    """Each word is there, where there are fewer than are compared exactly."""
    samples, frame = seen(60.0)
    evidence = single_evidence(samples, frame, SPEC)
    assert isinstance(evidence, Evidence)
    book = Codebook.build([7], load_dictionary("DICT_4X4_50"), SPEC)
    assert sorted(codewords.rank_codewords(evidence, book.white).codewords) == [0, 1, 2, 3]
