"""Reading one picture of a panel whose corners are known: the right ID, or a reason, and never another ID."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import Floats, PanelSpec, Rejected, Transfer
from ledpi.decode.evidence.classes import band_shares
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.codewords import rank_codewords
from ledpi.decode.identify.decision import FALSE_ID_RATE, Reading, decide
from tests.builders.decode import (
    SHORT_US,
    SPEC,
    TRUE_10_MS_US,
    WORDS,
    Bits,
    Canvas,
    Profile,
    diffuser,
    drawn,
    flat,
    square,
    word,
)
from tests.builders.samples import evidence_at, read_at

ALL = Codebook.build(list(range(50)), load_dictionary("DICT_4X4_50"), SPEC)
# Patterns by the number of cells in which they differ from the nearest word of the dictionary, however it is turned
# (from a search over all 65536; words differ from each other in three cells or more).
TWO_OFF = ("1001/1110/0001/0010", "0111/1100/1110/0101", "1101/0110/1011/0010")
FURTHER_OFF = ("0000/0100/0101/1110", "0001/0100/0011/1110", "1001/0011/1100/0010", "1110/1011/0010/1101")


def panel_shown(
    cells: Bits,
    *,
    side: float = 100.0,
    seed: int = 0,
    exposure_us: float = TRUE_10_MS_US,
    transfer: Transfer = "srgb",
    light: float = 0.4,
    gains: Floats | None = None,
    spec: PanelSpec = SPEC,
    profile: Profile = diffuser,
) -> Reading | Rejected:
    """The reading of a painted panel; place, noise and phases are the seed's."""
    rng = np.random.default_rng(seed)
    corners = square(310 + rng.uniform(), 240 + rng.uniform(), side, 4)
    canvas = Canvas(exposure_us=exposure_us, transfer=transfer)
    phases = (float(rng.uniform()), float(rng.uniform()))
    canvas.panel(corners, cells, light=light, profile=profile, gains=gains, spec=spec, phases=phases)
    return read_at(canvas.frame(seed), corners, ALL)


def reading_of(result: Reading | Rejected) -> tuple[int, int] | str:
    return (result.id, result.quarter_turns) if isinstance(result, Reading) else result.key


@pytest.mark.parametrize("quarter_turns", range(4))
@pytest.mark.parametrize("marker_id", WORDS)
def test_every_word_is_read_whichever_way_up(marker_id: int, quarter_turns: int) -> None:
    """The ID, and by how many quarter turns clockwise; one LED in ten weaker, the others uneven by a half."""
    gains = np.random.default_rng(marker_id).uniform(0.5, 1.0, (4, 4))
    gains[1, 2] = 0.1
    assert reading_of(panel_shown(word(marker_id, quarter_turns), gains=gains)) == (marker_id, quarter_turns)


@pytest.mark.parametrize("side", [110, 130, 170, 250])
def test_a_near_panel_leaves_little_open(side: float) -> None:
    """A twentieth of what its word explains, beside the noise: cells differ by no more than that of their bands."""
    canvas, corners = Canvas(), square(310.3, 240.6, side)
    canvas.panel(corners, word(7))
    fit = rank_codewords(evidence_at(canvas.frame(), corners), ALL.white)
    by_noise = 0.5 * 15 * 4  # in 15 cells that need not be as the first
    assert fit.of_cells - fit.likelihood[0] < by_noise + 0.05 * fit.likelihood[0]


@pytest.mark.parametrize("transfer", ["linear", "srgb"])
@pytest.mark.parametrize("exposure_us", [TRUE_10_MS_US, SHORT_US])
@pytest.mark.parametrize("side", [85, 300])
def test_invisible_and_full_bands_are_read_at_every_size(side: float, exposure_us: float, transfer: Transfer) -> None:
    """At 10 ms they are a few grey levels deep, at 150 µs black and white; the same picture gives the same reading."""
    one, other = (panel_shown(word(23, 1), side=side, exposure_us=exposure_us, transfer=transfer) for _ in "12")
    assert reading_of(one) == (23, 1)
    assert isinstance(one, Reading)
    assert isinstance(other, Reading)
    assert one.margin == other.margin


def test_hot_spots_that_saturate_do_not_matter() -> None:
    """The middle of every cell is blown out; the rest of it carries the bands."""

    def hot(u: Floats, v: Floats) -> Floats:
        x, y = 4 * u % 1.0 - 0.5, 4 * v % 1.0 - 0.5
        return 0.7 + 1.5 * np.exp(-(x * x + y * y) / 0.01)

    canvas, corners = Canvas(), square(310.3, 240.6, 140, 4)
    canvas.panel(corners, word(7), light=0.5, profile=hot)
    assert reading_of(read_at(canvas.frame(), corners, ALL)) == (7, 0)


def test_other_frequencies_and_duty_are_read_where_they_are_known() -> None:
    """A panel that was built differently, with a codebook that says so; seen aside, half as wide as high."""
    spec = PanelSpec(side_m=0.16, black_hz=1450.0, white_hz=2050.0, duty=0.3)
    book = Codebook.build(list(range(50)), load_dictionary("DICT_4X4_50"), spec)
    canvas, corners = Canvas(), np.array([[280.3, 140.6], [351.7, 162.2], [352.1, 317.4], [279.8, 341.9]])
    canvas.panel(corners, word(42), spec=spec)
    assert reading_of(read_at(canvas.frame(), corners, book)) == (42, 0)


def test_the_bands_depth_is_reported() -> None:
    """Amplitude over the mean of either class at 10 ms: the first harmonic of a square wave, box-filtered."""
    shown = panel_shown(word(7), side=240)
    assert isinstance(shown, Reading)
    expected = [4 / np.pi * abs(np.sinc(hz * TRUE_10_MS_US * 1e-6)) for hz in (1250, 2450)]
    np.testing.assert_allclose(shown.amplitude, expected, rtol=0.2)


@pytest.mark.table
@pytest.mark.parametrize(
    ("black", "white", "is_read"),
    [(1.0, 0.45, True), (1.0, 0.3, False), (0.3, 1.0, False), (0.3, 0.3, True), (0.2, 0.2, False), (1.7, 1.5, False)],
)
def test_no_panel_is_as_deep_as_that(black: float, white: float, is_read: bool) -> None:
    """Bands of a panel are so deep as expected, or thinned alike; texture's are not."""
    bands = band_shares(word(7).ravel().astype(np.float64), 4) * np.array([black, 0.0, white, 0.0]) * 0.1
    information = np.zeros((16, 4, 16, 4))
    information[range(16), :, range(16), :] = 1e5 * np.eye(4)
    evidence = Evidence(score=1e5 * bands, information=information, prior=np.full(4, 0.1**2 / 2))
    result = decide(evidence, ALL, FALSE_ID_RATE)
    assert reading_of(result) == ((7, 0) if is_read else "identify.implausible_depth")


def test_more_light_makes_a_surer_reading() -> None:
    """Bands are a share of the light, its noise only the root of it: the margin grows with every doubling."""
    margins = []
    for light in (0.05, 0.1, 0.2, 0.4):
        shown = [panel_shown(word(7), light=light, seed=seed) for seed in range(3)]
        assert all(reading_of(s)[0] == 7 for s in shown)
        margins.append(np.mean([s.margin for s in shown if isinstance(s, Reading)]))
    assert (np.diff(margins) > 0).all()


def walled(u: Floats, v: Floats) -> Floats:
    """Cells like lamps behind glass, with walls between them as wide as an eighth of a cell."""
    inner = np.minimum(np.abs(4 * u - np.clip(np.round(4 * u), 1, 3)), np.abs(4 * v - np.clip(np.round(4 * v), 1, 3)))
    return np.asarray(diffuser(u, v) * (inner > 0.06))


@pytest.mark.slow
@pytest.mark.parametrize(("profile", "side"), [(flat, 52), (diffuser, 52), (walled, 90), (walled, 105)])
def test_what_neighbours_and_the_dark_beyond_the_rim_mix_in_does_not_matter(profile: Profile, side: float) -> None:
    """Uneven LEDs, small cells: the blur reaches over the gaps, if there are any, and the rim has no neighbour.

    At 105 pixels the outermost points are out of the blur's reach, but not of what walls do.
    """
    read = 0
    for seed in range(8):
        gains = np.random.default_rng(seed).normal(1.0, 0.1, (4, 4))
        shown = panel_shown(word(7, seed % 4), side=side, seed=seed, gains=gains, profile=profile)
        read += reading_of(shown) == (7, seed % 4)
    assert read >= 7


@pytest.mark.slow
@pytest.mark.parametrize("side", [60, 80, 120])
def test_full_bands_are_read_in_every_phase(side: float) -> None:
    """At 150 µs some cells are dark in most of their rows, and what is seen of others is mostly harmonics."""
    for seed in range(4):
        shown = panel_shown(word(7, seed % 4), side=side, seed=seed, exposure_us=SHORT_US)
        assert reading_of(shown) == (7, seed % 4)


@pytest.mark.parametrize("side", [20, 40])
@pytest.mark.parametrize("pattern", TWO_OFF)
def test_full_bands_in_few_pixels_are_not_taken_for_a_word_nearby(pattern: str, side: float) -> None:
    """Far less than noise stands between a word and its neighbours there: what fits badly is not believed."""
    for seed in range(6):
        assert isinstance(panel_shown(drawn(pattern), side=side, seed=seed, exposure_us=SHORT_US), Rejected)


# ---- What is no word is not read as one


@pytest.mark.parametrize("side", [60, 100, 160])
def test_a_pattern_that_is_no_word_is_rejected(side: float) -> None:
    """It blinks as panels do, but two cells or more are of the other class in every word.

    All of one class is a ceiling light; all classes swapped are as far from a word as can be.
    """
    others = [drawn(pattern) for pattern in (*TWO_OFF, *FURTHER_OFF)]
    for seed, cells in enumerate([*others, np.zeros((4, 4), bool), np.ones((4, 4), bool), ~word(7), ~word(23)]):
        assert isinstance(panel_shown(cells, side=side, seed=seed), Rejected)


@pytest.mark.parametrize("side", [26, 60, 200])
def test_what_is_lit_but_does_not_blink_is_rejected(side: float) -> None:
    """A panel whose driver hangs: all that makes it one is there but the bands; an even lamp is rejected as such."""
    panel, lamp, corners = Canvas(), Canvas(), square(310.3, 240.6, side, 4)
    panel.lamp(corners, 0.4, profile=diffuser)
    lamp.lamp(corners, 0.4)
    for seed in range(4):
        assert isinstance(read_at(panel.frame(seed), corners, ALL), Rejected)
        assert side < 60 or reading_of(read_at(lamp.frame(seed), corners, ALL)) == "identify.steady"


def printed_marker(u: Floats, v: Floats) -> Floats:
    """ID 7's word in black and white."""
    row, column = (np.clip((4 * w).astype(int), 0, 3) for w in (v, u))
    return np.where(word(7)[row, column], 1.0, 0.15)


def stripes(u: Floats, v: Floats) -> Floats:
    """Horizontal bars, in some cells as far apart as bands, in others closer."""
    return 1.0 + 0.2 * np.sin(2 * np.pi * np.where((4 * u).astype(int) % 2 == 0, 4.2, 8.2) * v)


def blotches(u: Floats, v: Floats) -> Floats:
    """A picture on the wall."""
    return 1.0 + 0.3 * np.sin(9 * u + 4 * v) * np.cos(13 * v - 5 * u * v)


@pytest.mark.parametrize("texture", [printed_marker, stripes, blotches])
@pytest.mark.parametrize("side", [60, 100, 160])
def test_a_still_texture_is_rejected(side: float, texture: object) -> None:
    """Whatever is drawn on it, what does not blink is no panel."""
    assert callable(texture)
    canvas, corners = Canvas(), square(310.3, 240.6, side, 4)
    canvas.lamp(corners, 0.4, profile=texture)
    for seed in range(3):
        assert isinstance(read_at(canvas.frame(seed), corners, ALL), Rejected)


@pytest.mark.slow
@pytest.mark.parametrize(("black_hz", "white_hz"), [(1000, 2000), (1500, 3000), (1000, 1500), (100, 120)])
def test_a_panel_of_other_frequencies_is_rejected(black_hz: float, white_hz: float) -> None:
    """Another system's panel, or lamps on the mains."""
    other = dataclasses.replace(SPEC, black_hz=black_hz, white_hz=white_hz)
    for marker_id in (7, 12, 23):
        for turns in range(4):
            assert isinstance(panel_shown(word(marker_id, turns), spec=other, seed=turns), Rejected)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("black_hz", "white_hz", "side", "seeds"),
    [
        (625, 1225, 80, (23, 64, 166, 191)),
        (310, 480, 100, (40, 61, 81, 92, 117, 118, 161, 178)),
    ],
)
def test_a_panel_of_lower_frequencies_is_never_another_id(
    black_hz: float, white_hz: float, side: float, seeds: tuple[int, ...]
) -> None:
    """Long bands look a little like ours within a cell. Those that once were misread, of 192 pictures each."""
    other = dataclasses.replace(SPEC, black_hz=black_hz, white_hz=white_hz)
    for seed in seeds:
        marker_id, turns = (7, 12, 17, 23)[seed % 4], seed // 4 % 4
        shown = panel_shown(word(marker_id, turns), spec=other, side=side, seed=seed)
        assert isinstance(shown, Rejected)


@pytest.mark.slow
@pytest.mark.parametrize("gain", [0.0, 0.5])
def test_a_dead_cell_never_makes_another_id(gain: float) -> None:
    """Each cell in turn: with 15 of 16 cells the panel is read, or rejected."""
    for cell in range(16):
        gains = np.ones(16)
        gains[cell] = gain
        shown = panel_shown(word(7), gains=gains.reshape(4, 4), seed=cell)
        assert isinstance(shown, Rejected) or (shown.id, shown.quarter_turns) == (7, 0)


def test_dictionaries_that_hold_only_some_ids_know_no_others() -> None:
    """A codebook of two panels does not read a third one as either."""
    book = Codebook.build([7, 23], load_dictionary("DICT_4X4_50"), SPEC)
    canvas, corners = Canvas(), square(310.3, 240.6, 100, 4)
    canvas.panel(corners, word(12))
    assert isinstance(read_at(canvas.frame(), corners, book), Rejected)


@pytest.mark.slow
def test_too_little_to_see_is_a_reason_and_no_guess() -> None:
    """As the panel shrinks to nothing, a reading is right or there is none."""
    for side in (12, 16, 20, 26, 40):
        for seed in range(3):
            canvas, corners = Canvas(), square(310.3, 240.6, side, 4)
            canvas.panel(corners, word(7), profile=flat)
            shown = read_at(canvas.frame(seed), corners, ALL)
            assert isinstance(shown, Rejected) or (shown.id, shown.quarter_turns) == (7, 0)
