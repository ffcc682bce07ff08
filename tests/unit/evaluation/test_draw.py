"""Drawings are as the condition says: places, cases, decoys, and prints in the panels' place."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from evaluation.suites.conditions import (
    DECOYS,
    VARIATIONS,
    Condition,
    Suite,
    suite_conditions,
)
from evaluation.suites.draw import Take, draw_take
from evaluation.suites.readers import aruco_reader, printed_id, printed_scene
from evaluation.suites.units import photographed
from ledpi.camera.simulate.render import Renderer, scene_truth
from ledpi.camera.simulate.sensor import sensor_info
from ledpi.config.panels import PanelSettings
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import Decoded, Frame
from ledpi.pipeline.pipeline import Pipeline
from ledpi.workshop.evaluate.scoring import FRAMES_A_TAKE

PANELS = PanelSettings(side_m=0.16)
ALL_EXIST = PanelSettings(side_m=0.16, ids=tuple(range(50)))  # those too that a part of another panel can show
WORDS = load_dictionary("DICT_4X4_50").rotated_codewords()


def condition(
    suite: Suite = "paper", case: str = "plain", distance_m: float = 1.0, angle_deg: float = 0.0
) -> Condition:
    return Condition(suite=suite, case=case, distance_m=distance_m, angle_deg=angle_deg)


def take_of(what: Condition, number: int = 0, seed: int = 1) -> Take:
    return draw_take(what, PANELS, seed, number)


def decoys_of(case: str, exposure_us: float) -> Condition:
    (found,) = (
        c
        for c in suite_conditions("decoys", exposures_us=(exposure_us,), transfers=("srgb",), any_roll=True)
        if c.case == case
    )
    return found


def alone(take: Take, seq: int) -> Decoded:
    """Returns what a frame of a take shows by itself."""
    sensor = take.scene.sensor
    path = Pipeline(sensor_info(sensor, 1.0), PANELS, intrinsics=sensor.intrinsics, stream=False)
    return path.decode(Renderer(take.scene, seed=take.seed).frame(seq))


def first_frame(take: Take) -> Frame:
    return next(photographed(take, take.scene, 1))


def test_the_papers_experiment() -> None:
    """0.4 to 2.0 m by 0.2 m, and seven angles at 0.6 m, of which 0° is among the distances already; names are keys."""
    places = [(c.distance_m, c.angle_deg) for c in suite_conditions("paper", transfers=["srgb"], any_roll=False)]
    distances_m = (0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0)
    at_10_ms = places[: len(places) // 2]
    assert at_10_ms == [(d, 0.0) for d in distances_m] + [(0.6, a) for a in (-70, -45, -20, 20, 45, 70)]
    suites: tuple[Suite, ...] = ("paper", "beyond", "robustness", "decoys")
    names = [c.name for s in suites for c in suite_conditions(s, transfers=["srgb", "linear"], any_roll=True)]
    assert len(set(names)) == len(names)


def test_a_take_is_its_seed_condition_and_number() -> None:
    """Drawn and photographed again it is the same, pixel by pixel; another number or seed is another."""
    again = [first_frame(take_of(condition(), *which)).pixels for which in ((3, 1), (3, 1), (4, 1), (3, 2))]
    np.testing.assert_array_equal(again[0], again[1])
    assert not np.array_equal(again[0], again[2])
    assert not np.array_equal(again[0], again[3])


@pytest.mark.parametrize("case", VARIATIONS)
def test_cases_differ_from_the_plain_take_in_the_case_alone(case: str) -> None:
    """The same IDs in the same room, so that small differences between rates mean something."""
    plain, varied = take_of(condition(), 5).scene, take_of(condition("robustness", case), 5).scene
    assert varied.panels[0].marker_id == plain.panels[0].marker_id
    assert varied.room.texture == plain.room.texture
    if VARIATIONS[case].panels == 1:
        here, there = (scene.panels[0].motion.scene_from_body(0.0) for scene in (varied, plain))
        np.testing.assert_array_equal(here, there)


@pytest.mark.parametrize(("distance_m", "angle_deg"), [(0.4, 0.0), (2.0, 0.0), (0.6, -70.0), (12.0, 0.0)])
def test_a_panel_stands_where_the_condition_says(distance_m: float, angle_deg: float) -> None:
    """At the distance, its normal at the angle to the line of sight, wholly in view, at any roll."""
    rolls = []
    for number in range(12):
        take = take_of(condition(distance_m=distance_m, angle_deg=angle_deg), number)
        pose = take.scene.panels[0].motion.scene_from_body(0.0)
        assert np.linalg.norm(pose[:3, 3]) == pytest.approx(distance_m)
        cosine = float(-pose[:3, 2] @ pose[:3, 3] / distance_m)
        assert math.degrees(math.acos(min(1.0, cosine))) == pytest.approx(abs(angle_deg), abs=1e-3)
        (truth,) = scene_truth(take.scene, 0)
        assert not truth.optional
        top = truth.corners_px[1] - truth.corners_px[0]
        rolls.append(math.atan2(top[1], top[0]))
    assert np.ptp(rolls) > math.pi


def test_a_misreported_row_time() -> None:
    """The driver says 33.67 µs and 296 rows of exposure; the rows take 31.75 µs, and so it is 9.4 ms.

    The frame's period may be given, else it is the daemon's choice; a case that is about the period keeps its own.
    """
    take = take_of(condition("robustness", "row time misreported by 6 %"))
    info = sensor_info(take.scene.sensor, take.reported_row_time)
    assert (take.scene.sensor.row_time_us, info.row_time_us) == pytest.approx((31.749, 33.673), abs=1e-3)
    assert (take.scene.sensor.exposure_us, info.exposure_us) == pytest.approx((9397.6, 9967.1), abs=0.1)
    assert first_frame(take).exposure_us == pytest.approx(9967.1, abs=0.1)
    frozen = condition("robustness", "frames of 20 ms, both phases freeze")
    drawn = [
        draw_take(*asked)
        for asked in (
            (condition(), PANELS, 1, 0),
            (condition(), PANELS, 1, 0, 17_788.0),
            (frozen, PANELS, 1, 0, 17_788.0),
        )
    ]
    assert [each.scene.sensor.frame_length_rows for each in drawn] == [507, 528, 594]


def test_driving_moves_the_panel_and_keeps_it_in_view() -> None:
    """At 1 m the panel moves by pixels from frame to frame, and is in each of them."""
    moved = []
    for number in range(8):
        scene = take_of(condition("robustness", "driving"), number).scene
        places = [scene_truth(scene, seq)[0] for seq in range(FRAMES_A_TAKE)]
        assert not any(truth.optional for truth in places)
        moved.append(float(np.abs(places[-1].corners_px - places[0].corners_px).max()))
    assert max(moved) > 50


@pytest.mark.parametrize("kind", DECOYS)
def test_decoys_are_no_markers(kind: str) -> None:
    """None has a truth; of each kind some are in view; so many cells at least differ from every word, however turned.

    Of a decoy with a dead cell those that are lit: else it would show what a word with a dead cell does.
    """
    what = replace(condition("decoys", kind), distance_m=None, angle_deg=None)
    least = {"near_words": 2, "mirrored": 1, "single_class": 2, "hidden_strip": 2, "dead_cell": 2}.get(kind, 0)
    for number in range(20 if least else 4):
        scene = take_of(what, number).scene
        assert scene_truth(scene, 0) == ()
        assert len(scene.panels) + len(scene.lights) >= 1
        for panel in scene.panels:
            lit = np.broadcast_to(panel.cell_gains, panel.codeword.shape) > 0
            assert ((panel.codeword != WORDS) & lit).sum(axis=(2, 3)).min() >= least
            assert kind == "parts" or (~lit).sum() == (kind == "dead_cell")


@pytest.mark.parametrize(("angle_deg", "most_px"), [(0.0, 0.3), (45.0, 0.4)])
def test_opencv_finds_the_print_where_the_panel_was(angle_deg: float, most_px: float) -> None:
    """Its black border's outer edge is the lit grid's; in linear light, where nothing shifts the edges."""
    what = replace(condition(distance_m=0.8, angle_deg=angle_deg), transfer="linear")
    for number in range(3):
        take = take_of(what, number)
        scene = printed_scene(take.scene, "aruco", "DICT_4X4_50", take.peak_level)
        frame = next(photographed(take, scene, 1))
        (read,) = aruco_reader("DICT_4X4_50", 0.16, take.scene.sensor.intrinsics).read(frame).found
        (truth,) = scene_truth(take.scene, 0)
        assert read.id == truth.id
        assert np.hypot(*(read.corners_px - truth.corners_px).T).max() < most_px
        assert read.pose is not None
        np.testing.assert_allclose(read.pose.position_m, truth.camera_from_marker.position_m, atol=0.005)


def test_apriltag_finds_its_print_where_the_panel_was() -> None:
    """Its corners, brought into our order and pixel convention, are the panel's."""
    pytest.importorskip("pupil_apriltags", reason="pupil-apriltags is not installed (extra: suites)")
    from evaluation.suites.readers import apriltag_reader

    take = take_of(replace(condition(distance_m=0.8), transfer="linear"), 2)
    scene = printed_scene(take.scene, "apriltag", "DICT_4X4_50", take.peak_level)
    frame = next(photographed(take, scene, 1))
    (read,) = apriltag_reader(0.16, take.scene.sensor.intrinsics).read(frame).found
    (truth,) = scene_truth(take.scene, 0)
    assert read.id == printed_id("apriltag", "DICT_4X4_50", truth.id)
    assert np.hypot(*(read.corners_px - truth.corners_px).T).max() < 0.4


@pytest.mark.parametrize(
    ("case", "exposure_us", "number", "seed", "seq"),
    [
        # A second look had explained what it believed, of a lamp at 838, 4520, 2061, 2216 Hz.
        ("pwm_lights", 10_000.0, 207, 1, 4),
        # The same at 1146 Hz, where one light explained more in a first look than the word did.
        ("pwm_lights", 10_000.0, 304, 3, 5),
        # A second look added a half to four fifths of what the first had explained.
        ("pwm_lights", 10_000.0, 390, 3, 2),
        # Of what the word explained a third was left, or an eighth: two short flashes; a frame across a bright sheet.
        ("pwm_lights", 10_000.0, 522, 2, 6),
        ("single_class", 10_000.0, 273, 2, 7),
        # One class explained more than the word did.
        ("single_class", 10_000.0, 52, 2, 7),
        # Two cells off, at a rate of 1e-5, that one in 100,000 frames is read by.
        ("near_words", 10_000.0, 334, 3, 1),
        # A pattern twelve cells off explained more than the word did, by other phases.
        ("mirrored", 10_000.0, 359, 2, 0),
        # A second look added nine nats to the odds against another ID, of which a first had found 2.6; one that
        # believes the other ID is for that.
        ("mirrored", 10_000.0, 107, 4242, 2),
        # A lattice a row beside the panel.
        ("mirrored", 10_000.0, 476, 7, 6),
        ("parts", 150.0, 20, 6, 11),  # half a panel, as 22 and 37 of DICT_4X4_50, one cell off what repeats by twos
        ("parts", 150.0, 205, 51, 6),  # two columns of three, as 42
        ("parts", 640.0, 130, 51, 6),  # two cells, as 22
        ("parts", 640.0, 144, 51, 1),  # two by two, as 37
        ("parts", 640.0, 147, 51, 3),  # three in a row, as 10
        ("parts", 640.0, 242, 51, 0),  # two rows, as 37
        # Of cells 5 and 7 px high, where neighbours' light at a cell's rim blinks otherwise than its own.
        ("near_words", 640.0, 5, 62, 0),  # three cells off word 5
        ("mirrored", 640.0, 14, 62, 0),  # two cells off word 24
        # The same, with a dead cell: by an estimate of its own it explained more than the word by its.
        ("dead_cell", 2000.0, 4, 2912, 5),
    ],
)
def test_what_is_no_panel_of_words_is_no_word(case: str, exposure_us: float, number: int, seed: int, seq: int) -> None:
    """Each of these was read once, in a frame alone; at 10 ms it is found, and weighed."""
    decoded = alone(take_of(decoys_of(case, exposure_us), number=number, seed=seed), seq)
    assert decoded.markers == ()
    assert exposure_us < 10_000.0 or any(why.stage == "identify" for why in decoded.rejected)


def test_what_a_first_look_leaves_open_a_second_one_reads() -> None:
    """By sinusoids a pattern that is no word is as likely but for 0.4 nats; by square waves it is not."""
    take = draw_take(condition("beyond", distance_m=1.8), ALL_EXIST, 1, 125)
    sensor = take.scene.sensor
    decoded = Pipeline(sensor_info(sensor, 1.0), ALL_EXIST, intrinsics=sensor.intrinsics, stream=False)
    assert [marker.detection.id for marker in decoded.decode(first_frame(take)).markers] == [17]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "number", "seed", "frames", "exposure_us"),
    [
        ("parts", 17, 52, 7, 150.0),
        ("parts", 29, 53, 12, 640.0),  # of five rows of pixels a cell, too few for the fit of a whole picture
        ("mirrored", 812, 2, 2, 10_000.0),  # in the second frame as a word five cells off, which explained as much
        ("mirrored", 954, 1, 4, 10_000.0),  # at frequencies a percent off, which explained a fifth
        ("near_words", 200, 6, 6, 10_000.0),  # by a lattice a row beside it: the wall does not blink
        ("mirrored", 248, 7, 3, 10_000.0),  # the same, where the wall was dark but for one cell
    ],
)
def test_panels_of_no_word_are_not_read_in_streams(
    case: str, number: int, seed: int, frames: int, exposure_us: float
) -> None:
    """Each of these was read once."""
    take = take_of(decoys_of(case, exposure_us), number=number, seed=seed)
    sensor = take.scene.sensor
    pipeline = Pipeline(sensor_info(sensor, 1.0), PANELS, intrinsics=sensor.intrinsics, stream=True)
    assert [pipeline.decode(frame).markers for frame in photographed(take, take.scene, frames)] == [()] * frames
