"""Noise that neighbouring pixels share: evidence claims no more than it leaves."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from ledpi.core.records import Frame
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.noise import Correlation
from ledpi.decode.evidence.single_frame import single_evidence
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


def test_walls_are_not_taken_for_noise() -> None:
    """Neighbours share what no model tells of a cell's rim, but it is no noise."""
    corners = square(310.2, 239.6, 52.0, 8)
    canvas = Canvas()
    canvas.panel(corners, word(7), profile=diffuser)
    frame = canvas.frame(seed=3)
    evidence = single_evidence(samples_of(frame, corners), frame, SPEC)
    assert isinstance(evidence, Evidence)
    assert math.log(evidence.noise.inflation) == pytest.approx(0.0, abs=0.1)


def test_what_tells_nothing_changes_nothing() -> None:
    """Nor does a deviation in which any inflation may be."""
    assert Correlation(0.4, 0.3, 4.0).inflation == 1.0
