"""The robot's place by mapped panels: as exact as the corners, as honest as the map, none rather than wrong."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest

from ledpi.core.records import Floats, RobotFix
from tests.builders.map import WALL, Driver, errors, panel, pose, seen_corners, with_errors

BASE = pose((0.3, -0.1, 0.0), 3.0)


def fix_of(answer: tuple[object, RobotFix | str | None]) -> RobotFix:
    fix = answer[1]
    assert isinstance(fix, RobotFix), fix
    return fix


def scenes(count: int, seed: int) -> Iterator[tuple[Floats, dict[int, Floats]]]:
    """Robots about the map's origin, with all three panels in the picture, and what they see of each."""
    rng = np.random.default_rng(seed)
    while count:
        base = pose((rng.uniform(-0.6, 0.6), rng.uniform(-0.3, 0.3), 0.0), rng.uniform(-5, 8))
        exact = {i: seen_corners(base, place) for i, place in WALL.items()}
        if all(((c > 2) & (c < (637, 477))).all() for c in exact.values()):
            count -= 1
            yield base, {i: with_errors(c, rng) for i, c in exact.items()}


@pytest.mark.parametrize("ids", [(7,), (7, 9), (7, 8, 9)])
def test_exact_corners_give_the_exact_fix(ids: tuple[int, ...]) -> None:
    """Through the camera's mount, which is turned and shifted, to 0.1 mm."""
    near = pose((1.9, 0.2, 0.0), 5.0)
    driver = Driver(panels={7: panel((3.0, 0.5, 1.0), 215), 8: panel((3.2, 0.1, 1.2), 150), 9: panel((3, 0, 0.8), 140)})
    fix = fix_of(driver.see({i: seen_corners(near, driver.panels[i]) for i in ids}))
    np.testing.assert_allclose(errors(fix, near), np.zeros(6), atol=1e-4)
    assert fix.panels_used == ids
    assert fix.panels_rejected == ()


def test_three_panels_beat_the_best_of_them() -> None:
    """100 scenes: the joint position's rms is at most two thirds of the best single panel's nearer pose.

    And its errors are as large as its covariance says: the mean of eᵀ·covariance⁻¹·e within the 95 % band of a χ² of 6.
    """
    joint, nees = [], []
    single: dict[int, list[float]] = {i: [] for i in WALL}
    for base, seen in scenes(100, seed=3):
        fix = fix_of(Driver().see(seen))
        error = errors(fix, base)
        joint.append(float(error[:3] @ error[:3]))
        assert fix.map_from_base_link.covariance is not None
        nees.append(error @ np.linalg.solve(fix.map_from_base_link.covariance, error))
        for i, corners in seen.items():
            driver = Driver()
            (marker,), _ = driver.see({i: corners})
            solutions = [s for s in (marker.solution, marker.alternate) if s is not None]
            alone = [fix_of(driver.fix_with(marker, s)) for s in solutions]
            single[i].append(min(float(e @ e) for e in (errors(f, base)[:3] for f in alone)))
    best = min(np.mean(values) for values in single.values())
    assert math.sqrt(best / np.mean(joint)) >= 1.5
    assert abs(np.mean(nees) - 6) < 1.96 * math.sqrt(12 * 100) / 100


@pytest.mark.parametrize("moved", WALL)
def test_a_panel_that_hangs_elsewhere_is_named_and_left_out(moved: int) -> None:
    """20 cm to any side: the fix is that of the others."""
    rng = np.random.default_rng(moved)
    for base, seen in scenes(15, seed=moved):
        wrong = {i: place.copy() for i, place in WALL.items()}
        shift = rng.standard_normal(3)
        wrong[moved][:3, 3] += 0.2 * shift / np.linalg.norm(shift)
        fix = fix_of(Driver(panels=wrong, sigma_m=0.005, sigma_rad=0.005).see(seen))
        assert fix.panels_rejected == (moved,)
        assert fix.panels_used == tuple(sorted(set(WALL) - {moved}))
        right = {i: place for i, place in WALL.items() if i != moved}
        others = fix_of(Driver(panels=right, sigma_m=0.005, sigma_rad=0.005).see(seen))
        np.testing.assert_allclose(errors(fix, base), errors(others, base), atol=2e-3)


def test_a_map_that_is_as_good_as_it_says_is_believed() -> None:
    """Panels are 1 cm and 1° off, and the map's deviations say so: none is rejected, and the errors fit."""
    rng = np.random.default_rng(8)
    nees = []
    for base, seen in scenes(60, seed=8):
        measured = {}
        for i, place in WALL.items():
            off = pose((0, 0, 0), math.degrees(rng.normal(0, 0.0175)), math.degrees(rng.normal(0, 0.0175)))
            measured[i] = place.copy()
            measured[i][:3, :3] = off[:3, :3] @ place[:3, :3]
            measured[i][:3, 3] += rng.normal(0, 0.01, 3)
        fix = fix_of(Driver(panels=measured, sigma_m=0.01, sigma_rad=0.0175).see(seen))
        assert fix.panels_rejected == ()
        error = errors(fix, base)
        assert fix.map_from_base_link.covariance is not None
        nees.append(error @ np.linalg.solve(fix.map_from_base_link.covariance, error))
    assert 3 < np.mean(nees) < 8  # about 6; less, as only two of the three angles were off


def test_panels_that_the_map_does_not_know_are_left_out() -> None:
    """They are reported as markers, but are no part of the fix; alone they give none."""
    seen = {i: seen_corners(BASE, place) for i, place in WALL.items()}
    driver = Driver(panels={i: WALL[i] for i in (7, 9)})
    markers, fix = driver.see(seen)
    assert len(markers) == 3
    assert isinstance(fix, RobotFix)
    assert fix.panels_used == (7, 9)
    assert fix.panels_rejected == ()
    assert driver.see({8: seen[8]})[1] == "fix.not_in_map"


def mirror_pair() -> tuple[Floats, dict[int, Floats]]:
    """Straight ahead, 4 m away, turned by 12°: both poses fit."""
    return pose((-1.0, 0.0, 1.0)), {7: panel((3.0, 0.0, 1.4), 192)}


def test_what_one_panel_leaves_open_is_open_for_its_fix() -> None:
    """60 looks at a panel 3.6 m away: its two poses are 0.7 m apart, and in some looks only one is a minimum."""
    place, base, rng = panel((3.193, 0.972, 0.866), 193.4, 13.0), pose((-0.43, -0.08, 0.0)), np.random.default_rng(1)
    fixes = []
    for _ in range(60):
        markers, fix = Driver(panels={7: place}, sigma_m=0.005, sigma_rad=0.005).see(
            {7: with_errors(seen_corners(base, place), rng)}
        )
        if markers[0].alternate is not None:
            fixes.append(fix)
    assert len(fixes) > 50
    assert all(fix == "fix.ambiguous" for fix in fixes)


def test_the_fix_before_tells_which_of_two_poses_it_is() -> None:
    """Another panel leaves the view: the first alone goes on where the robot was, whichever pose looks likelier.

    The other would be 1.6 m to the side.
    """
    base, panels = mirror_pair()
    panels[8] = panel((2.5, 0.9, 1.2), 220)
    rng = np.random.default_rng(2)
    driver = Driver(panels=panels, sigma_m=0.002, sigma_rad=0.002)
    fix_of(driver.see({i: seen_corners(base, place) for i, place in panels.items()}))
    for _ in range(10):
        fix = fix_of(driver.see({7: with_errors(seen_corners(base, panels[7]), rng)}))
        assert np.linalg.norm(errors(fix, base)[:3]) < 0.6
        assert fix.panels_used == (7,)


def moved_map(*moved: int) -> dict[int, Floats]:
    """The wall, with these panels hung 0.5 m to some side, each to another."""
    wrong = {i: place.copy() for i, place in WALL.items()}
    for i in moved:
        shift = np.random.default_rng(i).standard_normal(3)
        wrong[i][:3, 3] += 0.5 * shift / np.linalg.norm(shift)
    return wrong


def driven(panels: dict[int, Floats], *phases: tuple[int, ...]) -> list[list[RobotFix | str | None]]:
    """Returns what a robot gets that sees these panels, five frames a phase, while the map has them at `panels`."""
    driver = Driver(panels=panels, sigma_m=0.005, sigma_rad=0.005)
    seen = {i: seen_corners(BASE, place) for i, place in WALL.items()}
    return [[driver.see({i: seen[i] for i in ids})[1] for _ in range(5)] for ids in phases]


def deviations_off(fix: RobotFix) -> float:
    """By how many standard deviations its position errs."""
    error, covariance = errors(fix, BASE)[:3], fix.map_from_base_link.covariance
    assert covariance is not None
    return math.sqrt(error @ np.linalg.solve(covariance[:3, :3], error))


@pytest.mark.parametrize("order", list(itertools.permutations(WALL))[::2])
@pytest.mark.parametrize("moved", WALL)
def test_a_panel_that_hangs_elsewhere_misleads_nobody_once_another_is_seen(
    moved: int, order: tuple[int, int, int]
) -> None:
    """In every order of first sight, and whichever are seen afterwards: no fix is more than 3 deviations off.

    Alone, and before any other, it gives a wrong fix: nothing contradicts it.
    """
    a, b, c = order
    _, *later = driven(moved_map(moved), (a,), (a, b), (b,), (a,), (a, b, c), (a,), (b,), (c,), (a, c), (b, c), (a, b))
    fixes = [fix for phase in later for fix in phase if isinstance(fix, RobotFix)]
    assert fixes
    assert max(map(deviations_off, fixes)) < 3.0
    assert not any(moved in fix.panels_used for fix in fixes)


@pytest.mark.parametrize("moved", [7, 8])
def test_a_fix_by_the_accused_panel_alone_is_no_witness(moved: int) -> None:
    """Whichever of two is seen first, and whichever hangs elsewhere: none is believed, also when it is seen alone.

    Nor is a fix of the same frame that came before the newcomer, nor are both believed where both come at once.
    """
    _, *later = driven(moved_map(moved), (7,), (7, 8), (7,), (8,))
    assert {fix for phase in later for fix in phase} == {"fix.panels_contradict"}
    driver = Driver(panels=moved_map(8), sigma_m=0.005, sigma_rad=0.005)
    both = {i: seen_corners(BASE, WALL[i]) for i in (7, 8)}
    fix_of(driver.see({7: both[7]}))
    driver.seq -= 1
    assert driver.see(both)[1] == "fix.panels_contradict"
    assert Driver(panels=moved_map(8), sigma_m=0.005, sigma_rad=0.005).see(both)[1] == "fix.panels_contradict"


def test_a_third_panel_is_a_witness_long_after_it_was_seen() -> None:
    """9 agreed with 7, and has left the view: 8, which contradicts 7, is rejected."""
    *_, last = driven(moved_map(8), (7, 9), *[(7,)] * 20, (7, 8))
    for fix in last:
        assert isinstance(fix, RobotFix)
        assert (fix.panels_used, fix.panels_rejected) == ((7,), (8,))


def test_a_robot_does_not_leap_from_one_panels_fix_to_anothers() -> None:
    """7 and 9 leave the view, 8 comes alone: its fix would be 0.5 m from theirs."""
    _, after = driven(moved_map(8), (7, 9), (8,))
    assert set(after) == {"fix.panels_contradict"}


def test_a_map_whose_panels_all_contradict_each_other_gives_no_fix() -> None:
    """Each of three hangs elsewhere: nothing but the first panel's fix, before another is seen."""
    first, *later = driven(moved_map(7, 8, 9), (7,), (7, 8), (7, 8, 9), (8, 9), (9,), (8,), (7,))
    assert all(isinstance(fix, RobotFix) for fix in first)
    assert {fix for phase in later for fix in phase} == {"fix.panels_contradict"}


def test_a_panel_that_is_hung_right_again_is_believed_again() -> None:
    """After as many frames as accused it."""
    driver = Driver(sigma_m=0.005, sigma_rad=0.005)
    right = {i: seen_corners(BASE, WALL[i]) for i in (7, 9)}
    elsewhere = {**right, 9: seen_corners(BASE, moved_map(9)[9])}
    assert {driver.see(elsewhere)[1] for _ in range(3)} == {"fix.panels_contradict"}
    assert [isinstance(driver.see(right)[1], RobotFix) for _ in range(10)][-6:] == [True] * 6


@pytest.mark.slow
def test_a_right_map_is_believed_in_nearly_every_frame() -> None:
    """A robot that sees two or three panels by turns, with errors as large as stated: 2 fixes of 400 are refused."""
    rng = np.random.default_rng(4)
    driver = Driver(sigma_m=0.005, sigma_rad=0.005)
    seen = {i: seen_corners(BASE, place) for i, place in WALL.items()}
    turns = [(7, 9), (7, 8, 9), (8, 9), (7, 8)] * 10
    fixes = [driver.see({i: with_errors(seen[i], rng) for i in ids})[1] for ids in turns for _ in range(10)]
    assert sum(not isinstance(fix, RobotFix) for fix in fixes) <= 2


def test_the_time_is_that_of_the_panels_mean_row() -> None:
    """Between the rows of its panels; corners are brought there by their velocity."""
    driver = Driver()
    seen = {i: seen_corners(BASE, WALL[i]) for i in (7, 8)}
    markers, fix = driver.see(seen)
    assert isinstance(fix, RobotFix)
    assert fix.mid_exposure_ns == pytest.approx(np.mean([m.mid_exposure_ns for m in markers]), abs=2)


@pytest.mark.parametrize(("stream", "frames_later"), [(False, 0), (True, 40)])
def test_frames_alone_and_after_half_a_second_have_no_past(stream: bool, frames_later: int) -> None:
    """An ambiguity of one frame stays open, as with `ledpi decode --single-frame`; or the robot may have turned."""
    base, panels = mirror_pair()
    both = {**panels, 8: panel((2.5, 0.9, 1.2), 220)}
    driver = Driver(panels=both, stream=stream, sigma_m=0.002, sigma_rad=0.002)
    fix_of(driver.see({i: seen_corners(base, place) for i, place in both.items()}))
    driver.seq += frames_later
    assert driver.see({7: seen_corners(base, panels[7])})[1] == "fix.ambiguous"
