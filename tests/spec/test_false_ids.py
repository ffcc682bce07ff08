"""The rate at which a panel that shows no word is taken for one: as was asked for."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import pytest

from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import Floats
from ledpi.decode.evidence.evidence import UNFIT, Evidence
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.evidence.waves import are_sinusoids
from ledpi.decode.identify import decision
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.codewords import SHORTLIST, likeliest_far_pattern, near_pattern_likelihood, rank_codewords
from ledpi.decode.identify.decision import Reading, decide, odds_needed
from ledpi.decode.identify.one_frame import read_frame
from tests.builders.decode import SPEC, TRUE_10_MS_US, Canvas, square, word
from tests.builders.evidence_reference import word_log_likelihoods
from tests.builders.samples import WEIGHER, erased_cells, evidence_at, observed, read_at

DICTIONARY = load_dictionary("DICT_4X4_50")
FLAT = np.arange(16)
HARD_PX = 30.0  # a panel's side where patterns are mistaken most: 16 cm at 3.1 m


def evidence_of(side: float, seed: int) -> Evidence:
    """Draws that of one frame of panel 7, anywhere in its bands."""
    rng = np.random.default_rng(seed)
    corners = square(310 + rng.uniform(), 240 + rng.uniform(), side, rng.uniform(-45, 45))
    canvas = Canvas(exposure_us=TRUE_10_MS_US)
    gains = 1 + 0.05 * rng.standard_normal((4, 4))
    canvas.panel(corners, word(7), gains=gains, phases=(rng.uniform(), rng.uniform()))
    return evidence_at(canvas.frame(seed), corners)


def drawn_from(evidence: Evidence, rng: np.random.Generator) -> Evidence:
    """As another frame would have it, if panel 7 had the bands that fit it best, and noise were all there is."""
    flat = word(7).ravel().astype(np.float64)
    _, bands, _ = word_log_likelihoods(evidence, flat[None].astype(np.float32))
    shown = np.where(np.arange(4) < 2, 1 - flat[:, None], flat[:, None]) * bands[0]
    matrix = evidence.information.reshape(64, 64)
    values, vectors = np.linalg.eigh(matrix)
    noise = vectors @ (np.sqrt(np.maximum(values, 0)) * rng.standard_normal(64))
    score: Floats = (matrix @ shown.ravel() + noise).reshape(16, 4)
    return evidence._replace(score=score)


def codebook_with(own: np.ndarray) -> Codebook:
    """As if a dictionary of as many words as DICT_4X4_50 had this one, and none near it."""
    return Codebook(
        ids=np.array([0] + [1] * 199),
        quarter_turns=np.zeros(200, np.int64),
        white=np.concatenate([own[None], np.repeat(~own[None], 199, axis=0)]).astype(np.float32),
        correctable=1,
        spec=SPEC,
    )


@pytest.mark.slow
def test_of_all_patterns_as_many_are_taken_for_a_word_as_was_asked_for() -> None:
    """1 in 100, within a factor of 2: where most are, evenly over all patterns two or more cells off every word."""
    rng, shown = np.random.default_rng(0), word(7).ravel()
    # A pattern has so many words at a distance of two and three cells: those of DICT_4X4_50, by all that are none.
    chances = {2: 200 * 120 / 62_136, 3: 200 * 560 / 62_136}
    taken: dict[int, list[bool]] = {2: [], 3: []}
    for seed in range(25):
        evidence = drawn_from(evidence_of(HARD_PX, seed), rng)
        for cells, found in taken.items():
            every = list(combinations(range(16), cells))
            for i in rng.permutation(len(every))[:60].tolist():
                read = decide(evidence, codebook_with(shown ^ np.isin(FLAT, every[i])), 1e-2)
                found.append(isinstance(read, Reading) and read.id == 0)
    share = sum(chances[cells] * float(np.mean(found)) for cells, found in taken.items())
    assert 0.005 < share < 0.02


@pytest.mark.parametrize(
    ("exposure_us", "sinusoids"),
    [(640.0, False), (800.0, False), (2000.0, False), (3000.0, True), (9400.0, True), (TRUE_10_MS_US, True)],
)
def test_what_the_exposure_leaves_of_square_waves_may_be_sinusoids(exposure_us: float, sinusoids: bool) -> None:
    """At 640 µs bands are 0.3 deep, at 2 ms 0.16. At 800 µs 1250 Hz is gone, and of 2450 Hz 0.026 is left: for 1.96
    cycles (2/π)·2·sin(0.04π)/(1.96π). Of its third harmonic, for 5.88 cycles, 0.0085: a third as much.
    """
    assert are_sinusoids(exposure_us, SPEC) is sinusoids


@pytest.mark.slow
@pytest.mark.parametrize(("exposure_us", "side"), [(640.0, 24.0), (640.0, 28.0), (2000.0, 28.0)])
def test_patterns_two_cells_off_are_no_words_where_they_are_none(exposure_us: float, side: float) -> None:
    """Neighbours' light shows at the rim of small cells there, and noise is little: odds are high for whatever fits.

    By a look at sinusoids alone one or two of these 960 passed.
    """
    rng, shown = np.random.default_rng(0), word(7).ravel()
    every, taken = list(combinations(range(16), 2)), []
    for seed in range(8):
        corners = square(310 + rng.uniform(), 240 + rng.uniform(), side, rng.uniform(-45, 45))
        canvas = Canvas(exposure_us=exposure_us)
        gains = 1 + 0.05 * rng.standard_normal((4, 4))
        canvas.panel(corners, word(7), gains=gains, phases=(rng.uniform(), rng.uniform()))
        seen = observed(canvas.frame(seed), corners)
        for cells in every:
            read = read_frame(seen, codebook_with(shown ^ np.isin(FLAT, cells)), WEIGHER)
            taken += [cells] if isinstance(read, Reading) and read.id == 0 else []
    assert taken == []


def test_what_is_asked_for_is_the_chance_where_two_patterns_are_mistaken_most() -> None:
    """Log-likelihood ratios are normal with mean D, variance 2D: at the worst D so many are below −odds."""
    needed = odds_needed(1e-2)
    d = np.geomspace(0.5, 20, 30)[:, None]
    ratios = d + np.sqrt(2 * d) * np.random.default_rng(0).standard_normal(200_000)
    assert (ratios < -needed).mean(axis=1).max() == pytest.approx(1e-2, rel=0.1)


def without(evidence: Evidence, *cells: int) -> Evidence:
    """As if these gave no light."""
    score, information = evidence.score.copy(), evidence.information.copy()
    for cell in cells:
        score[cell] = information[cell] = information[:, :, cell] = 0.0
    return evidence._replace(score=score, information=information)


def test_neighbours_beside_a_silent_cell() -> None:
    """A cell that gives no light is left as it is."""
    evidence = without(evidence_of(40.0, 2), 5)
    own, others = word(7).ravel(), np.flatnonzero(FLAT != 5)
    near = [own ^ np.isin(FLAT, each) for cells in (1, 2, 3) for each in combinations(others, cells)]
    exact = float(np.logaddexp.reduce(word_log_likelihoods(evidence, np.array(near, np.float32))[0]))
    assert near_pattern_likelihood(evidence, own.astype(np.float32), 1, 3) == pytest.approx(exact, abs=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_the_likeliest_pattern_is_found(seed: int) -> None:
    """Tries all 4096 that twelve cells may show, more than one cell from the word."""
    evidence, own = without(evidence_of(40.0, seed), 0, 5, 6, 15), word(7).ravel().astype(np.float32)
    patterns = np.tile(own, (4096, 1))
    patterns[:, ~erased_cells(evidence)] = (np.arange(4096)[:, None] >> np.arange(12)) & 1
    beyond = patterns[np.abs(patterns - own).sum(axis=1) > 1]
    most = float(word_log_likelihoods(evidence, beyond)[0].max())
    likelihood, mine = likeliest_far_pattern(evidence, own, 1)
    assert likelihood == pytest.approx(most)
    assert float(word_log_likelihoods(evidence, mine[None])[0][0]) == pytest.approx(most)


def test_a_pattern_two_cells_off_a_word_of_a_larger_grid_is_none() -> None:
    """As in the smaller: one cell may be wrong, although the dictionary could correct three."""
    assert Codebook.build([0], load_dictionary("DICT_5X5_50"), SPEC).correctable == 1
    assert Codebook.build([0], DICTIONARY, SPEC).correctable == 1


def test_faint_bands_that_tell_nothing_are_not_looked_at_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """6 px a cell: no second look would make a word of these."""
    monkeypatch.setattr(LightWeigher, "with_harmonics", lambda *_: pytest.fail("looked at twice"))
    corners, canvas = square(310.3, 240.6, 24, 9), Canvas(exposure_us=TRUE_10_MS_US)
    canvas.panel(corners, word(7))
    book = Codebook.build(list(range(50)), DICTIONARY, SPEC)
    assert read_at(canvas.frame(1), corners, book) == decision.NO_CODEWORD


def test_neighbours_on_the_largest_grid() -> None:
    """8 × 8 cells, the last of which is bit 63 of a pattern; its change is what makes the likeliest one."""
    rng, size = np.random.default_rng(0), 64 * 4
    root = rng.standard_normal((size, size))
    own = rng.integers(0, 2, 64).astype(np.float32)
    other = own.copy()
    other[63] = 1 - other[63]
    shown = np.where(np.arange(4) < 2, 1 - other[:, None], other[:, None]) * (0.3, 0.1, -0.2, 0.2)
    information = root @ root.T
    evidence = Evidence(
        score=(information @ shown.ravel()).reshape(64, 4),
        information=information.reshape(64, 4, 64, 4),
        prior=np.full(4, 0.1),
    )
    changed = np.eye(64)[list(range(64))]
    near = [np.abs(own - changed[a] - (changed[b] if a != b else 0)) for a in range(64) for b in range(a + 1)]
    exact = float(np.logaddexp.reduce(word_log_likelihoods(evidence, np.array(near, np.float32))[0]))
    assert near_pattern_likelihood(evidence, own, 1, 2) == pytest.approx(exact, abs=0.01)
    likelihood, likeliest_one = likeliest_far_pattern(evidence, own, 0)
    np.testing.assert_array_equal(likeliest_one, other)
    assert likelihood == pytest.approx(float(word_log_likelihoods(evidence, other[None])[0][0]))


def test_a_panel_that_seems_to_end_in_the_dark_is_not_read() -> None:
    """Found a cell aside, a near word had its dark surroundings for a column, and the rest was that of panel 16."""
    evidence, book = evidence_of(60.0, 1), Codebook.build([7], DICTIONARY, SPEC)
    assert isinstance(decide(without(evidence, 3, 6, 9), book, 1e-6), Reading)
    for rim in ((0, 1, 2, 3), (3, 7, 11, 15), (0, 1, 2), (11, 15)):
        assert decide(without(evidence, *rim), book, 1e-6) == decision.INCONSISTENT


def test_a_rival_that_cannot_be_weighed_is_not_beaten() -> None:
    """Evidence that is indefinite where only the negative of panel 7 has bands: a likelihood that is no number."""
    evidence, book = evidence_of(60.0, 1), Codebook.build([7], DICTIONARY, SPEC)
    assert isinstance(decide(evidence, book, 1e-6), Reading)
    information, white = evidence.information.copy(), np.flatnonzero(word(7).ravel())
    for cell in white:
        information[cell, 0, white[white != cell], 0] = -1e6
    result = decide(evidence._replace(information=information), book, 1e-6)
    assert result == UNFIT


def test_what_is_no_number_is_no_lack_of_memory() -> None:
    """Neighbours of evidence that is not finite have no likelihood, and that is told."""
    evidence = evidence_of(60.0, 1)
    evidence.score[3, 2] = math.nan
    own = word(7).ravel().astype(np.float32)
    assert math.isnan(near_pattern_likelihood(evidence, own, 2, 3))
    assert math.isnan(likeliest_far_pattern(evidence, own, 1)[0])


def test_a_word_that_cannot_be_told_roughly_hides_none_after_it() -> None:
    """The last place of the shortlist taken by one: panel 7's own word, which comes next, is on it all the same."""
    evidence, own = evidence_of(60.0, 1), word(7).ravel().astype(np.float32)
    assert own[0] == 1  # white: what the first cell says of the black wave does not concern it
    evidence.information[0, 0, 0, 1] = evidence.information[0, 1, 0, 0] = 1e9
    poor, uninformative = np.ones(16, np.float32), np.zeros(16, np.float32)
    white = np.array([*[poor] * (SHORTLIST - 1), uninformative, own])
    assert SHORTLIST in rank_codewords(evidence, white).codewords


@pytest.mark.parametrize("wall", [0.02, 0.1, 0.12, 0.2, 0.4])
def test_a_lattice_a_column_beside_its_panel_shows_no_word(wall: float) -> None:
    """Though the other twelve cells are those of word 7: a dark wall says nothing, and a lit one does not blink."""
    true = square(310.4, 240.2, 120.0, 15.0)
    for seed in range(4):
        canvas = Canvas(background=wall, exposure_us=TRUE_10_MS_US)
        canvas.panel(true, np.roll(word(7), -1, axis=1), light=0.4)
        book = Codebook.build(list(range(50)), DICTIONARY, SPEC)
        aside = true - (true[1] - true[0]) / 4
        assert not isinstance(read_at(canvas.frame(seed), aside, book), Reading)
