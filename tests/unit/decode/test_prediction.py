"""What a panel that was read lets expect of its next frame: painted panels, each by itself."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from ledpi.core.geometry import project_to_quad
from ledpi.core.records import Floats, Frame, PanelSpec
from ledpi.decode.cells import CellSamples, lattice
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.evidence.prediction import LEAST_SHARE, Prediction, nuisance_basis
from ledpi.decode.identify import decision
from ledpi.decode.identify.codebook import Codebook
from ledpi.markers.dictionaries import load_dictionary
from tests.builders.decode import FRAME_ROWS, ROW_TIME_US, SPEC, Canvas, diffuser, square, word
from tests.builders.evidence_reference import slopes_of
from tests.builders.samples import samples_of

PERIOD_US = FRAME_ROWS * ROW_TIME_US
PLACE = square(310.3, 240.6, 100, 4)
BOOK = Codebook.build(list(range(50)), load_dictionary("DICT_4X4_50"), SPEC)
READ_FRAMES = 5


def frame_of(
    seq: int, marker_id: int = 7, *, corners: Floats = PLACE, spec: PanelSpec = SPEC, gains: Floats | None = None
) -> Frame:
    canvas = Canvas()
    canvas.panel(corners, word(marker_id), start_us=seq * PERIOD_US, spec=spec, gains=gains)
    return dataclasses.replace(canvas.frame(seq, seq=seq), row0_readout_ns=round(1e9 + 1e3 * seq * PERIOD_US))


@pytest.fixture(scope="module")
def expected() -> Prediction:
    """Of panel 7, after five frames."""
    return expected_after(READ_FRAMES)


@pytest.fixture(scope="module")
def expected_soon() -> Prediction:
    """Of panel 7, after its first frame: the bands of that are still in the picture."""
    return expected_after(1)


def expected_after(frames: int) -> Prediction:
    memory = PanelMemory(SPEC)
    for seq in range(frames):
        frame = frame_of(seq)
        memory, _ = memory.add_frame(samples_of(frame, PLACE), frame)
    evidence = memory.evidence()
    if isinstance(evidence, Evidence):
        reading = decision.decide(evidence, BOOK, decision.FALSE_ID_RATE)
    else:
        reading = decision.read_codeword(*memory.newest, BOOK, decision.FALSE_ID_RATE)
    assert isinstance(reading, decision.Reading)
    assert reading.id == 7
    return Prediction.from_memory(memory, reading.cell_bands, reading.likelihood / memory.effective_frames)


@pytest.mark.parametrize("seq", [5, 6, 7, 12, 30])
def test_the_same_panel_is_as_expected(expected: Prediction, seq: int) -> None:
    """Soon, and half a second later: the oscillators run on."""
    frame = frame_of(seq)
    assert expected.matches(samples_of(frame, PLACE), frame)


@pytest.mark.parametrize("off_px", [(0.3, -0.2), (-0.25, 0.3)])
def test_corners_may_be_a_little_off(expected: Prediction, off_px: tuple[float, float]) -> None:
    """By more than they usually are."""
    frame = frame_of(6)
    assert expected.matches(samples_of(frame, PLACE + off_px), frame)


@pytest.mark.parametrize("seq", range(5, 11))
def test_a_panel_that_only_shines_is_not(expected: Prediction, seq: int) -> None:
    """Its driver hangs, all cells lit."""
    canvas = Canvas()
    canvas.lamp(PLACE, profile=diffuser)
    frame = dataclasses.replace(canvas.frame(seq, seq=seq), row0_readout_ns=round(1e9 + 1e3 * seq * PERIOD_US))
    assert not expected.matches(samples_of(frame, PLACE), frame)


@pytest.mark.parametrize("other", [0, 12, 17, 23, 42])
def test_another_panel_in_the_place_is_not(expected: Prediction, other: int) -> None:
    """With the same phases, which is the hardest: half of its cells are as expected."""
    for seq in (5, 6, 9):
        frame = frame_of(seq, other)
        assert not expected.matches(samples_of(frame, PLACE), frame)


@pytest.mark.parametrize("other", [0, 12, 17, 23, 42])
def test_another_panel_in_the_place_is_not_from_the_second_frame_on(expected_soon: Prediction, other: int) -> None:
    """Whose cells each have a brightness of their own, so that most of what has changed is not bands."""
    gains = 1 + 0.08 * np.random.default_rng(other).normal(size=(4, 4))
    met = [expected_soon.matches(samples_of(frame, PLACE), frame) for frame in map(frame_of, range(1, 8))]
    assert sum(met) >= 5  # where bands are where they were, nothing is sure
    for seq in range(1, 8):
        frame = frame_of(seq, other, gains=gains)
        assert not expected_soon.matches(samples_of(frame, PLACE), frame)


def test_a_panel_with_one_other_cell_is_not(expected: Prediction) -> None:
    """All but one are as expected."""
    cells = word(7).copy()
    cells[1, 2] ^= True
    for seq in (5, 6, 9):
        canvas = Canvas()
        canvas.panel(PLACE, cells, start_us=seq * PERIOD_US)
        frame = dataclasses.replace(canvas.frame(seq, seq=seq), row0_readout_ns=round(1e9 + 1e3 * seq * PERIOD_US))
        assert not expected.matches(samples_of(frame, PLACE), frame)


def with_holes(samples: CellSamples, share: float, cell: int | None = None) -> CellSamples:
    """As if a share of the samples, or of one cell's, were saturated."""
    valid = np.random.default_rng(3).random(samples.light.shape) >= (share if cell is None else 0.0)
    if cell is not None:
        valid[cell, : round(share * valid.shape[1])] = False
    return dataclasses.replace(samples, valid=valid, light=samples.light * valid)


@pytest.mark.parametrize("seq", [5, 6, 9])
def test_with_a_few_samples_saturated_the_rest_is_compared(expected: Prediction, seq: int) -> None:
    """The same panel is as expected; with one other cell it is not."""
    assert expected.matches(with_holes(samples_of(frame := frame_of(seq), PLACE), 0.1), frame)
    cells = word(7).copy()
    cells[1, 2] ^= True
    canvas = Canvas()
    canvas.panel(PLACE, cells, start_us=seq * PERIOD_US)
    other = dataclasses.replace(canvas.frame(seq, seq=seq), row0_readout_ns=round(1e9 + 1e3 * seq * PERIOD_US))
    assert not expected.matches(with_holes(samples_of(other, PLACE), 0.1), other)


def log_likelihood_ratios(expected: Prediction, samples: CellSamples, frame: Frame) -> tuple[float, float]:
    """What `weigh` tells, by least squares: of off = light/picture − 1 − change, without what the basis explains."""
    valid = np.ones(samples.light.shape) if samples.valid is None else samples.valid.astype(np.float64)
    seconds = (frame.row0_readout_ns - expected.origin_ns) * 1e-9 + samples.rows * frame.row_time_us * 1e-6
    bands = expected.depth * np.cos(2 * np.pi * expected.hz[:, None] * seconds - expected.phase[:, None])
    change = bands - expected.residual_bands
    light = samples.light * ((expected.picture * valid).sum() / samples.light.sum())
    root, basis = expected.root * valid, (expected.basis * valid.ravel()).T
    off, bands, change = (
        (flat - basis @ np.linalg.lstsq(basis, flat, rcond=None)[0]).reshape(valid.shape) * valid
        for flat in (((each * root).ravel()) for each in (light / expected.picture - 1 - change, bands, change))
    )
    of_cells = np.minimum(*(((off + 0.5 * other) * other).sum(axis=1) for other in (bands, change)))
    variance = np.square(off).sum() / (valid.sum() - basis.shape[1])
    of_cells = of_cells * samples.independence / expected.noise_inflation / variance
    return float(of_cells.sum()), -float(np.minimum(of_cells, 0.0).sum())


@pytest.mark.parametrize("holes", [0.0, 0.1])
@pytest.mark.parametrize("shown", [7, 12])
def test_a_frame_is_weighed_by_what_is_left_of_its_light(expected: Prediction, shown: int, holes: float) -> None:
    """The same panel and another one, wholly seen and with a few samples saturated."""
    samples = samples_of(frame := frame_of(6, shown), PLACE)
    if holes:
        samples = with_holes(samples, holes)
    np.testing.assert_allclose(
        expected.log_likelihood_ratios(samples, frame),
        log_likelihood_ratios(expected, samples, frame),
        rtol=2e-3,
        atol=1e-3,
    )


def test_what_is_expected_of_a_mean_picture() -> None:
    """Its weights, the bands left in it; and an orthonormal basis of what wrong gain and wrong corners change."""
    memory = PanelMemory(SPEC)
    for seq in range(READ_FRAMES):
        memory, _ = memory.add_frame(samples_of(frame := frame_of(seq), PLACE), frame)
    bands = np.random.default_rng(4).normal(0, 0.04, (16, 4)) * np.repeat(word(7).reshape(-1, 1) == [0, 1], 2, axis=1)
    ours, mean = Prediction.from_memory(memory, bands, 0.0), memory.mean()
    weight = mean.picture * (mean.count / (mean.count + 1))
    np.testing.assert_allclose(ours.root, np.sqrt(weight / weight.mean()), rtol=1e-5)
    np.testing.assert_allclose(ours.residual_bands, np.einsum("cj,jcs->cs", bands, mean.waves), atol=1e-6)
    np.testing.assert_allclose(ours.basis @ ours.basis.T, np.eye(9), atol=1e-4)
    changes = np.concatenate([ours.root[None], slopes_of(mean.picture, ours.lattice) * ours.root]).reshape(9, -1)
    left = changes - (changes @ ours.basis.T) @ ours.basis
    np.testing.assert_allclose(left, 0.0, atol=1e-3 * float(np.abs(changes).max()))


@pytest.mark.parametrize(("corner", "axis"), [(0, 0), (1, 1), (2, 0), (3, 1)])
def test_corners_that_move_change_what_the_basis_holds(corner: int, axis: int) -> None:
    """By finite differences of a smooth light, taken where the lattice is once a corner has moved by 0.01 px."""
    points = lattice(4, 12)
    places = np.stack([points.u.ravel(), points.v.ravel()], axis=1)

    def light(by: float) -> Floats:
        corners = PLACE.copy()
        corners[corner, axis] += by
        x, y = project_to_quad(corners, places).T
        return np.asarray(0.5 + 0.2 * np.sin(x / 17 + y / 40) * np.cos(y / 23)).reshape(points.u.shape)

    here = light(0.0)
    change = np.log(light(0.01) / light(-0.01)) * np.sqrt(here / here.mean())
    basis = nuisance_basis(here.astype(np.float32), points)
    left = change.ravel() - (change.ravel() @ basis.T) @ basis
    assert np.linalg.norm(left) < 0.03 * np.linalg.norm(change)  # at the rim slopes are those of one side


def test_what_tells_far_less_than_frames_have_told_is_not_expected(expected: Prediction) -> None:
    """Its noise is what is left of it, and what is unlike the picture leaves much."""
    samples = samples_of(frame := frame_of(6), PLACE)
    told_nats, _ = expected.log_likelihood_ratios(samples, frame)
    assert expected.matches(samples, frame)
    assert not dataclasses.replace(expected, typical_nats=1.01 * told_nats / LEAST_SHARE).matches(samples, frame)


@pytest.mark.parametrize("seq", range(5, 11))
def test_a_frame_without_its_bands_misses_it(expected: Prediction, seq: int) -> None:
    """One with them does not; nor a panel so much smaller that it is sampled at other places."""
    canvas, own, smaller = Canvas(), frame_of(seq), square(310.3, 240.6, 40, 4)
    canvas.lamp(PLACE, profile=diffuser)
    lit = dataclasses.replace(canvas.frame(seq, seq=seq), row0_readout_ns=own.row0_readout_ns)
    assert expected.is_contradicted_by(samples_of(lit, PLACE), lit)
    assert not expected.is_contradicted_by(samples_of(own, PLACE), own)
    assert not expected.is_contradicted_by(samples_of(lit, smaller), lit)


def test_of_a_cell_that_is_mostly_saturated_nothing_is_sure(expected: Prediction) -> None:
    """It might be of the other class."""
    frame = frame_of(6)
    assert not expected.matches(with_holes(samples_of(frame, PLACE), 0.5, cell=5), frame)


def test_a_frozen_picture_is_not(expected: Prediction) -> None:
    """A camera that hangs and stamps its last picture anew: the bands should have moved on."""
    last = frame_of(READ_FRAMES - 1)
    for seq in (5, 6, 7):
        frame = dataclasses.replace(last, row0_readout_ns=round(1e9 + 1e3 * seq * PERIOD_US))
        assert not expected.matches(samples_of(frame, PLACE), frame)


def test_of_another_size_nothing_is_sure(expected: Prediction) -> None:
    """A lattice of other points has no picture to compare with."""
    further = square(310.3, 240.6, 30, 4)
    frame = frame_of(6, corners=further)
    samples = samples_of(frame, further)
    assert samples.lattice is not expected.lattice
    assert not expected.matches(samples, frame)


def test_what_noise_alone_shows_is_not() -> None:
    """Two hundred frames of a dim panel that does not blink, each against the expectation of one that did."""
    memory = PanelMemory(SPEC)
    for seq in range(READ_FRAMES):
        frame = frame_of(seq)
        memory, _ = memory.add_frame(samples_of(frame, PLACE), frame)
    bands = np.zeros((16, 4))
    bands[:8, 0], bands[8:, 2] = 0.004, 0.004  # so shallow that one frame hardly tells
    expectation = Prediction.from_memory(memory, bands, 0.0)
    canvas = Canvas()
    canvas.lamp(PLACE, profile=diffuser)
    met = 0
    for seed in range(200):
        met += expectation.matches(samples_of(frame := canvas.frame(seed), PLACE), frame)
    assert met <= 1  # e^-6 of 200 is 0.5
