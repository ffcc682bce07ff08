"""Noise that neighbouring pixels share: evidence claims no more than it leaves."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from ledpi.core.records import Floats, Frame
from ledpi.decode.evidence.comparison import Mean, compared_evidence
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.evidence.noise import WHITE, Correlation
from ledpi.decode.evidence.single_frame import single_evidence
from ledpi.decode.evidence.waves import class_waves
from tests.builders.decode import SPEC, TRUE_10_MS_US, Canvas, diffuser, square, word
from tests.builders.samples import samples_of

LEVEL, DEVIATION = 0.5, 0.02  # of light, and of a pixel's noise before anything is done to it


def noisy(seed: int, blur_px: float = 0.0, sharpened: float = 0.0) -> Frame:
    """An even light in which every pixel has noise of its own, and then is blurred or sharpened."""
    noise = np.random.default_rng(seed).normal(0.0, DEVIATION, (200, 200))
    if blur_px or sharpened:
        soft = cv2.GaussianBlur(noise, (0, 0), blur_px or 1.0)
        noise = soft if blur_px else noise + sharpened * (noise - soft)
    return Frame(
        pixels=np.round(255 * np.clip(LEVEL + noise, 0, 1)).astype(np.uint8),
        seq=seed,
        row0_readout_ns=seed * 16_900_000,
        exposure_us=TRUE_10_MS_US,
        row_time_us=33.67,
        transfer="linear",
    )


def spread_of(evidence: Evidence) -> float:
    """Mean square of what the score is over what it may be by what the information claims: 1 where that is right."""
    values, vectors = np.linalg.eigh(evidence.information.reshape(64, 64))
    told = values > 1e-3 * values[-1]
    return float(np.mean(np.square(vectors[:, told].T @ evidence.score.ravel()) / values[told]))


def compared(seed: int, corners: Floats, blur_px: float = 0.0, sharpened: float = 0.0) -> Evidence:
    """Of one noisy frame compared with another."""
    (first, before), (second, frame) = (
        (samples_of(frame, corners), frame)
        for frame in (noisy(seed, blur_px, sharpened), noisy(seed + 1, blur_px, sharpened))
    )
    mean = Mean(
        picture=first.light / first.light.mean(),
        count=np.ones_like(first.light),
        waves=class_waves(first, before, SPEC),
    )
    _, evidence = compared_evidence(second, frame, SPEC, class_waves(second, frame, SPEC, 0.0077), mean)
    assert isinstance(evidence, Evidence)
    return evidence


SIZES = pytest.mark.parametrize("side", [26.0, 38.0, 52.0], ids=lambda side: f"{side:.0f} px")


@SIZES
def test_white_noise_is_no_less_than_was_counted(side: float) -> None:
    """Samples are interpolated, and fitted: neither passes for noise that is alike."""
    corners = square(100.2, 99.6, side, 8)
    found = [compared(2 * seed, corners) for seed in range(10)]
    assert np.mean([each.noise.inflation for each in found]) < 1.05
    assert np.mean([spread_of(each) for each in found]) == pytest.approx(1.0, abs=0.25)


@SIZES
@pytest.mark.parametrize("blur_px", [0.5, 0.7])
def test_of_blurred_noise_evidence_claims_no_more_than_is_there(side: float, blur_px: float) -> None:
    """A score spreads as its information says; uncorrected it would by two to four times as much."""
    corners = square(100.2, 99.6, side, 8)
    found = [compared(2 * seed, corners, blur_px) for seed in range(10)]
    assert np.mean([spread_of(each) for each in found]) > 1.6
    assert 0.6 < np.mean([spread_of(each.discount(each.noise)) for each in found]) < 1.5


def test_what_one_picture_says_is_as_sure_as_its_noise_leaves_it() -> None:
    """The same of cells that are compared with each other."""
    corners = square(100.2, 99.6, 48.0, 8)
    spreads = []
    for seed in range(10):
        frame = noisy(seed, 0.7)
        evidence = single_evidence(samples_of(frame, corners), frame, SPEC)
        assert isinstance(evidence, Evidence)
        spreads.append(spread_of(evidence))
    assert 0.6 < np.mean(spreads) < 1.5


def test_sharpened_noise_is_never_taken_for_more_than_white() -> None:
    """Sharpening makes neighbours unlike: the odds are too small then, and stay so."""
    corners = square(100.2, 99.6, 48.0, 8)
    assert all(compared(2 * seed, corners, sharpened=0.5).noise.inflation == 1.0 for seed in range(3))


def test_walls_are_not_taken_for_noise() -> None:
    """What no model tells of a cell's rim is alike in neighbours, but no noise."""
    corners = square(310.2, 239.6, 52.0, 8)
    canvas = Canvas()
    canvas.panel(corners, word(7), profile=diffuser)
    frame = canvas.frame(seed=3)
    evidence = single_evidence(samples_of(frame, corners), frame, SPEC)
    assert isinstance(evidence, Evidence)
    assert math.log(evidence.noise.inflation) == pytest.approx(0.0, abs=0.1)


def test_frames_together_tell_better_how_alike_noise_is() -> None:
    """Of small cells one comparison tells little, eight do."""
    corners = square(100.2, 99.6, 26.0, 8)
    memory = PanelMemory(SPEC)
    for seed in range(9):
        frame = noisy(seed, 0.7)
        memory, _ = memory.add_frame(samples_of(frame, corners), frame)
    assert memory.noise.inflation > 2.0
    assert memory.noise.deviation < 0.5 * compared(0, corners, 0.7).noise.deviation


def test_the_mean_of_frames_by_hand() -> None:
    """The third of three weighs a third, and their deviation is that of one over √3."""
    together = Correlation(0.4, 0.03, 4.0).average(Correlation(0.1, 0.02, 5.0), 2.0)
    assert (together.excess, together.deviation) == pytest.approx((0.2, 0.03 / math.sqrt(3.0)))
    assert together.inflation == pytest.approx(math.exp(4.0 * (0.2 - 0.03 / math.sqrt(3.0))))


def test_what_tells_nothing_changes_nothing() -> None:
    """Nor does a deviation in which any inflation may be; white noise leaves evidence as it is."""
    assert Correlation(0.4, 0.3, 4.0).inflation == 1.0
    evidence = compared(0, square(100.2, 99.6, 40.0, 8))
    assert evidence.discount(WHITE) is evidence
