"""Frequencies told from a track's frames: what is proposed is always a panel that can be."""

from __future__ import annotations

import dataclasses

import pytest

from ledpi.core.dictionaries import load_dictionary
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.frequency_search import Proposal, propose_frequencies
from tests.builders.decode import SPEC, Canvas, square, word
from tests.builders.samples import observed, samples_of

PERIOD_US = 16_969.7  # in which 1250 and 1262 Hz both advance by nearly 21 cycles, and 20 Hz by a third of one


def proposed(
    announced: tuple[float, float],
    true: tuple[float, float],
    frames: int = 12,
    period_us: float = PERIOD_US,
    size_px: float = 60,
) -> Proposal | None:
    """The proposal from so many frames of panel 7, whose light varies; frequencies are (black, white) in Hz."""
    spec, shown = (dataclasses.replace(SPEC, black_hz=black, white_hz=white) for black, white in (announced, true))
    corners, seen = square(310.3, 240.6, size_px, 4), []
    for n in range(frames):
        canvas = Canvas()
        canvas.panel(corners, word(7), light=0.3 + 0.1 * (n % 3), spec=shown, start_us=n * period_us)
        frame = dataclasses.replace(canvas.frame(n, seq=n), row0_readout_ns=round(1e9 + 1e3 * n * period_us))
        seen.append(observed(frame, corners)._replace(samples=samples_of(frame, corners)))
    dictionary = load_dictionary("DICT_4X4_50")
    return propose_frequencies(seen, spec, Codebook.build(range(50), dictionary, spec))


def test_both_frequencies_are_reported() -> None:
    """Both oscillators are 1 % off."""
    found = proposed((1250.0, 2450.0), (1262.0, 2431.0))
    assert found is not None
    assert found.measured
    assert (found.spec.black_hz, found.spec.white_hz) == pytest.approx((1262.0, 2431.0), abs=0.5)


def test_four_frames_are_enough() -> None:
    """In 51 ms frequencies are told apart by a twentieth of the 20 Hz that this time resolves."""
    found = proposed((1250.0, 2450.0), (1262.0, 2431.0), frames=4)
    assert found is not None
    assert found.measured
    assert (found.spec.black_hz, found.spec.white_hz) == pytest.approx((1262.0, 2431.0), abs=3.0)


def test_what_does_not_stand_out_is_taken_to_stand_still() -> None:
    """1237.5 Hz advances by 21.0 cycles a frame: only the other's frequency is told."""
    found = proposed((1250.0, 2450.0), (1237.5, 2431.0))
    assert found is not None
    assert not found.measured
    assert (found.spec.black_hz, found.spec.white_hz) == pytest.approx((21e6 / PERIOD_US, 2431.0), abs=0.5)


@pytest.mark.parametrize("white_hz", [2425.5, 2474.5])
def test_a_frequency_is_not_taken_for_one_a_frame_rate_away(white_hz: float) -> None:
    """58.6 Hz from 2474.5, which is 1 % off, 2415.9 Hz advances as much from frame to frame, and is 1.4 % off."""
    found = proposed((1250.0, 2450.0), (1262.5, white_hz), frames=4, period_us=17_070.7)
    assert found is not None
    assert found.spec.white_hz == pytest.approx(white_hz, abs=3.0)


def test_a_wave_that_nearly_alternates_is_not_taken_for_its_mirror() -> None:
    """1262.5 Hz advances by −0.448 cycles in 17.07 ms, its mirror by 0.448, a tenth of a cycle further.

    Eight frames of cells that are 7 rows high, a third of a band, tell them apart, but not one by one: so the power of
    one alone has its top 1.4 Hz off.
    """
    found = proposed((1250.0, 2450.0), (1262.5, 2474.5), frames=8, period_us=17_070.7, size_px=30)
    assert found is not None
    assert found.spec.black_hz == pytest.approx(1262.5, abs=0.7)


def test_a_wave_that_hardly_advances_is_found_as_exactly() -> None:
    """1242.5 Hz advances by 21.08 cycles a frame: of it the mean of six takes most, and what is left counts for all."""
    found = proposed((1250.0, 2450.0), (1242.5, 2431.0), frames=6, size_px=40)
    assert found is not None
    assert found.spec.black_hz == pytest.approx(1242.5, abs=0.7)


def test_a_lamp_has_no_frequencies() -> None:
    """Nothing stands out of its noise."""
    corners, seen = square(310.3, 240.6, 60, 4), []
    for n in range(4):
        canvas = Canvas()
        canvas.lamp(corners, 0.4)
        frame = dataclasses.replace(canvas.frame(n, seq=n), row0_readout_ns=round(1e9 + 1e3 * n * PERIOD_US))
        seen.append(observed(frame, corners)._replace(samples=samples_of(frame, corners)))
    assert propose_frequencies(seen, SPEC, Codebook.build(range(50), load_dictionary("DICT_4X4_50"), SPEC)) is None


def test_a_slow_class_stands_still_at_no_frequency() -> None:
    """20 Hz, of which nothing is seen: the nearest that stands still is 0 Hz, and no panel blinks so."""
    assert proposed((20.0, 2450.0), (1262.0, 2450.0)) is None


def test_classes_that_are_near_each_other_are_distinguished() -> None:
    """Both of 1240 and 1262 Hz would stand still at 1237.5 Hz."""
    found = proposed((1240.0, 1262.0), (1250.0, 1262.0))
    assert found is not None
    assert (found.spec.black_hz, found.spec.white_hz) == pytest.approx((1250.0, 1262.0), abs=1.0)
