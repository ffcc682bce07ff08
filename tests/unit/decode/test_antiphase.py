"""Panels whose classes blink at one frequency, half a cycle apart: painted, and read as what they are or not at all."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import Frame, PanelSpec
from ledpi.decode.evidence.classes import band_shares, flip_classes
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.decision import Reading, decide
from ledpi.pipeline.pipeline import Pipeline
from tests.builders.decode import (
    FRAME_ROWS,
    PHASES,
    ROW_TIME_US,
    SHORT_US,
    SPEC,
    TRUE_10_MS_US,
    WORDS,
    Bits,
    Canvas,
    camera_info,
    panel_settings,
    square,
    word,
)
from tests.builders.samples import read_at

HZ = 1254.0  # of which 150 µs hold a fifth of a cycle, 10 ms twelve and a half
ANTIPHASE = dataclasses.replace(SPEC, black_hz=HZ, white_hz=HZ, phase="antiphase")
DICTIONARY = load_dictionary("DICT_4X4_50")
BOOK = Codebook.build(list(range(50)), DICTIONARY, ANTIPHASE)
PERIOD_US = FRAME_ROWS * ROW_TIME_US


def shown(
    cells: Bits,
    *,
    side: float = 100.0,
    seed: int = 0,
    exposure_us: float = TRUE_10_MS_US,
    phase: float | None = None,
    codebook: Codebook = BOOK,
) -> tuple[int, int] | str:
    """ID and turns of a painted antiphase panel, or why it was not read; white is half a cycle after black."""
    rng = np.random.default_rng(seed)
    corners = square(310 + rng.uniform(), 240 + rng.uniform(), side, 4)
    black = float(rng.uniform()) if phase is None else phase
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(corners, cells, spec=ANTIPHASE, phases=(black, black + 0.5))
    return read(canvas.frame(seed), side, seed, codebook)


def read(frame: Frame, side: float, seed: int, codebook: Codebook) -> tuple[int, int] | str:
    rng = np.random.default_rng(seed)
    result = read_at(frame, square(310 + rng.uniform(), 240 + rng.uniform(), side, 4), codebook)
    return (result.id, result.quarter_turns) if isinstance(result, Reading) else result.key


@pytest.mark.parametrize("exposure_us", [TRUE_10_MS_US, SHORT_US])
@pytest.mark.parametrize("marker_id", WORDS)
def test_every_word_is_read_whichever_way_up(marker_id: int, exposure_us: float) -> None:
    """The ID and its quarter turns, in invisible bands and full ones; its negative is the same half a cycle later."""
    for turns in (0, 1, 3):
        assert shown(word(marker_id, turns), exposure_us=exposure_us) == (marker_id, turns)
    assert shown(~word(marker_id), seed=5, exposure_us=exposure_us) == (marker_id, 0)


def test_one_frame_tells_more_than_of_two_frequencies() -> None:
    """38 px, as 16 cm at 2.7 m: cells are half a band high."""
    book = Codebook.build(list(range(50)), DICTIONARY, SPEC)
    own = of_two = 0
    for seed in range(8):
        own += shown(word(23), side=38, seed=seed) == (23, 0)
        rng = np.random.default_rng(seed)
        canvas = Canvas()
        canvas.panel(square(310 + rng.uniform(), 240 + rng.uniform(), 38, 4), word(23), phases=(seed / 8, 0.7))
        of_two += read(canvas.frame(seed), 38, seed, book) == (23, 0)
    assert own >= 6
    assert of_two <= own - 3


def test_between_a_word_and_anothers_negative_nothing_is_read() -> None:
    """ID 7 and the negative of ID 2 differ in two cells: a pattern that is one off either is neither, and nor are those
    two cells decided by anything but themselves.
    """
    seven, not_two = word(7), ~DICTIONARY.codeword(2)
    differ = np.argwhere(seven != not_two)
    assert len(differ) == 2
    for cell in differ:
        between = seven.copy()
        between[tuple(cell)] ^= True
        assert shown(between) == "identify.not_in_dictionary"
    assert shown(not_two) == (2, 0)


@pytest.mark.parametrize("seed", range(2))
def test_panels_of_two_frequencies_are_read_as_no_other(seed: int) -> None:
    """Black's frequency is the same. What all cells share is not known of one frame, so black's wave looks like half of
    it in black cells and half its negative in white ones: the word itself. The other way round, half is missing.
    """
    rng = np.random.default_rng(seed)
    corners = square(310 + rng.uniform(), 240 + rng.uniform(), 100, 4)
    canvas = Canvas()
    canvas.panel(corners, word(7), spec=dataclasses.replace(SPEC, black_hz=HZ), phases=PHASES)
    result = read(canvas.frame(seed), 100, seed, BOOK)
    assert result == (7, 0) or isinstance(result, str)
    free = Codebook.build(list(range(50)), DICTIONARY, dataclasses.replace(SPEC, black_hz=HZ))
    result = shown(word(7), seed=seed, codebook=free)
    assert result == (7, 0) or isinstance(result, str)


def test_words_that_are_each_others_negatives_are_not_looked_for() -> None:
    """38 and 69 of DICT_4X4_100: what one of them shows is read as neither; nor is what blinks as a whole."""
    dictionary = load_dictionary("DICT_4X4_100")
    book = Codebook.build(list(range(100)), dictionary, ANTIPHASE)
    assert not {38, 69} & set(book.ids.tolist())
    assert isinstance(shown(dictionary.codeword(38), codebook=book), str)
    for white in (False, True):
        assert isinstance(shown(np.full((4, 4), white)), str)


def drawn_evidence(shown: Bits, seed: int) -> Evidence:
    """Evidence of 16 cells that share much with each other: normal, as the decoder's own error model has it."""
    rng = np.random.default_rng(seed)
    other = rng.permutation(16)[:2]
    shared, _ = np.linalg.qr(rng.standard_normal((32, 20)))
    information = 6e4 * (np.eye(32) - 0.98 * shared @ shared.T)
    turn = 2 * np.pi * rng.random()
    signs = np.where(shown.ravel(), -1.0, 1.0)
    signs[other] *= -1.0
    bands = np.outer(signs, 0.05 * np.array([np.cos(turn), np.sin(turn)]))
    values, vectors = np.linalg.eigh(information)
    score = information @ bands.ravel() + vectors @ (np.sqrt(values) * rng.standard_normal(32))
    return Evidence(
        score=score.reshape(16, 2),
        information=information.reshape(16, 2, 16, 2),
        prior=np.full(2, 0.05**2 / 2),
    )


def test_what_fits_with_bands_of_its_own_is_weighed() -> None:
    """None of 150 patterns two cells off word 7, with noise, is read as a word; with the word's bands nine were."""
    identify_as = [decide(drawn_evidence(word(7), seed), BOOK, 1e-5) for seed in range(150)]
    assert not [reading for reading in identify_as if isinstance(reading, Reading)]


def frames_of(side: float, count: int, marker_id: int = 7, spec: PanelSpec = ANTIPHASE) -> list[Frame]:
    frames = []
    for n in range(count):
        canvas = Canvas()
        corners = square(310.3, 240.6, side, 4)
        canvas.panel(corners, word(marker_id), spec=spec, phases=(0.1, 0.6), start_us=n * PERIOD_US)
        frames.append(canvas.frame(n, seq=n))
    return frames


def antiphase_pipeline(*overrides: str) -> Pipeline:
    panels = panel_settings("panels.phase=antiphase", f"panels.black_hz={HZ}", f"panels.white_hz={HZ}", *overrides)
    return Pipeline(camera_info(), panels, intrinsics=None)


def test_a_stream_reads_it_far_away() -> None:
    """18 px, as 16 cm at 5.7 m: from the fourth frame on, and in each further one."""
    pipeline = antiphase_pipeline()
    ids = [[m.detection.id for m in pipeline.decode(frame).markers] for frame in frames_of(18, 12)]
    assert ids[3:] == [[7]] * 9


def test_a_stream_reads_an_oscillator_that_is_off() -> None:
    """By 1 %: found after six frames, and told."""
    off = dataclasses.replace(ANTIPHASE, black_hz=1.01 * HZ, white_hz=1.01 * HZ)
    pipeline = antiphase_pipeline("panels.search_frequencies=true")
    last = [pipeline.decode(frame) for frame in frames_of(24, 12, spec=off)][-1]
    assert [m.detection.id for m in last.markers] == [7]
    assert pipeline.likelihood.off_frequency[7].black_hz == pytest.approx(1.01 * HZ, abs=1.0)


def test_a_stream_tells_that_another_panel_took_the_place() -> None:
    """7 is gone, and 23 is there: 7 is not reported once more than a frame."""
    pipeline = antiphase_pipeline()
    frames = frames_of(40, 8) + frames_of(40, 16, marker_id=23)[8:]
    ids = [[m.detection.id for m in pipeline.decode(frame).markers] for frame in frames]
    assert ids[7] == [7]
    assert 7 not in [i for frame in ids[9:] for i in frame]
    assert ids[-1] == [23]


def test_what_cells_show_of_waves_by_hand() -> None:
    """Black and white of two waves, cosine and sine of each; in antiphase of one, white its negative."""
    classes = np.array([0.0, 1.0])
    assert band_shares(classes, 4).tolist() == [[1, 1, 0, 0], [0, 0, 1, 1]]
    assert band_shares(classes, 2).tolist() == [[1, 1], [-1, -1]]
    bands = np.array([2.0, 3.0, 5.0, 7.0])
    assert flip_classes(band_shares(classes, 4) * bands).tolist() == [[0, 0, 5, 7], [2, 3, 0, 0]]
    assert flip_classes(band_shares(classes, 2) * bands[:2]).tolist() == [[-2, -3], [2, 3]]
