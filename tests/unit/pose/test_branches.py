"""Which of a square's two poses is believed, over many frames; the solutions are written down here, not solved."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np

from ledpi.core.records import Floats, PlanarSolution, Pose
from ledpi.pose.branches import EXCLUDED_BY, Branches

FRAME_NS = 16_966_000
UP = np.array([0.0, -1.0, 0.0])  # of a level camera


def yawed(degrees: float, chi2: float, *, leans_deg: float = 0.0, sigma_deg: float = 0.5) -> PlanarSolution:
    """A panel 2 m ahead that faces the camera, turned about the vertical, then leaning back from it."""
    yaw, half_turn = (math.cos(math.radians(degrees) / 2), math.sin(math.radians(degrees) / 2)), (0.0, 1.0)
    lean = math.radians(180 + leans_deg) / 2
    x = (math.cos(lean), math.sin(lean)) if leans_deg else half_turn
    # About y by `degrees`, after about x by 180° and the lean: the product of the two quaternions.
    quaternion = np.array([yaw[0] * x[0], yaw[0] * x[1], yaw[1] * x[0], -yaw[1] * x[1]])
    covariance = np.diag([1e-6] * 3 + [math.radians(sigma_deg) ** 2] * 3)
    pose = Pose(position_m=np.array([0, 0, 2.0]), quaternion_wxyz=quaternion, covariance=covariance)
    return PlanarSolution(camera_from_marker=pose, reprojection_px=0.1, chi2=chi2)


def camera_turned(solution: PlanarSolution, degrees: float) -> PlanarSolution:
    """As a camera sees the panel that has turned by so much to its right."""
    half = math.radians(-degrees) / 2
    c, s = math.cos(half), math.sin(half)  # of a turn about y
    before = solution.camera_from_marker
    w, x, y, z = before.quaternion_wxyz
    a, _, b = before.position_m
    turned = replace(
        before,
        quaternion_wxyz=np.array([c * w - s * y, c * x + s * z, c * y + s * w, c * z - s * x]),
        position_m=np.array([math.cos(2 * half) * a + math.sin(2 * half) * b, 0, math.cos(2 * half) * b]),
    )
    return replace(solution, camera_from_marker=turned)


def pair(chi2_left: float, chi2_right: float, *, angle_deg: float = 20.0) -> tuple[PlanarSolution, ...]:
    """A frame's two solutions, turned to either side, the better first as they are solved."""
    both = yawed(-angle_deg, chi2_left), yawed(angle_deg, chi2_right)
    return both if chi2_left <= chi2_right else both[::-1]


def side(solution: PlanarSolution | None) -> str | None:
    """To which it is turned."""
    if solution is None:
        return None
    quaternion: Floats = solution.camera_from_marker.quaternion_wxyz
    return "right" if quaternion[1] * quaternion[3] < 0 else "left"


def watched(frames: list[tuple[PlanarSolution, ...]], branches: Branches | None = None) -> list[tuple[str | None, ...]]:
    branches = branches or Branches()
    chosen = [branches.choose(7, solutions, k * FRAME_NS) for k, solutions in enumerate(frames, start=1)]
    return [(side(best), side(other)) for best, other in chosen]


def test_the_better_one_is_believed_and_the_other_told_until_it_is_a_thousand_times_less_likely() -> None:
    """χ² differs by less or more than 2·ln 1000."""
    assert watched([pair(1.0, 0.8 + EXCLUDED_BY)]) == [("left", "right")]
    assert watched([pair(1.0, 1.2 + EXCLUDED_BY)]) == [("left", None)]


def test_one_solution_is_all_there_is() -> None:
    """A panel seen square on has one pose."""
    assert watched([(yawed(0.0, 1.0),)]) == [("left", None)]


def test_noise_does_not_turn_the_panel_over() -> None:
    """Ten frames for the left, then two that lean to the right: left it stays, and right is told."""
    seen = watched([pair(1.0, 6.0)] * 10 + [pair(4.0, 1.0)] * 2)
    assert seen == [("left", "right")] * 12


def test_what_was_wrong_is_given_up_once_the_frames_say_so() -> None:
    """And while they change places both are told."""
    seen = watched([pair(1.0, 3.0)] * 2 + [pair(20.0, 1.0)] * 20)
    assert seen[0] == ("left", "right")
    assert seen[-1][0] == "right"
    at = [best for best, _ in seen].index("right")
    assert seen[at] == ("right", "left")
    assert seen[at - 1] == ("left", "right")


def test_no_flip_is_silent_whatever_the_frames_say() -> None:
    """Random evidence, each frame for itself as sure as can be: where the belief changes both are told."""
    rng = np.random.default_rng(5)
    flips = 0
    for _ in range(50):
        evidence = rng.choice([-300.0, -15.0, 15.0, 300.0], size=40)
        seen = watched([pair(max(0.0, -e), max(0.0, e)) for e in evidence])
        for before, after in itertools.pairwise(seen):
            if before[0] != after[0]:
                flips += 1
                assert after[1] is not None
    assert flips > 20


def test_the_same_frame_again_is_no_new_evidence() -> None:
    """A resting robot's corners err alike in each frame: what one frame cannot exclude, a hundred do not."""
    assert watched([pair(1.0, 6.0)] * 100)[-1] == ("left", "right")


def test_a_turn_of_the_camera_does_not_confuse_the_two() -> None:
    """It turns by 15° from one frame to the next, so that right is seen now as left was."""
    branches = Branches()
    branches.choose(7, (yawed(-12.0, 1.0), yawed(12.0, 30.0)), FRAME_NS)
    both = camera_turned(yawed(12.0, 1.0), 15.0), camera_turned(yawed(-12.0, 2.0), 15.0)
    best, other = branches.choose(7, both, 2 * FRAME_NS)
    assert best.chi2 == 2.0
    assert other is not None


def test_once_the_two_have_met_what_was_before_says_nothing() -> None:
    """The robot passes in front of the panel: left cannot be told from right, and may be either afterwards."""
    apart, met = pair(1.0, 40.0), pair(1.0, 1.5, angle_deg=0.4)
    seen = watched([apart] * 10 + [met] + [pair(3.0, 1.0)])
    assert seen[9] == ("left", None)
    assert seen[-1] == ("right", "left")


def test_after_half_a_second_anything_may_have_happened() -> None:
    """Then the frame decides alone."""
    branches = Branches()
    for k in range(5):
        branches.choose(7, pair(1.0, 9.0), k * FRAME_NS + 1)
    best, _ = branches.choose(7, pair(2.0, 1.0), 600_000_000)
    assert side(best) == "right"


def after_a_gap(gap_s: float, *after: tuple[PlanarSolution, ...]) -> list[tuple[str | None, ...]]:
    """Returns what is believed of frames that come so long after 20 that were clearly for the left."""
    branches = Branches()
    watched([pair(1.0, 60.0)] * 20, branches)
    at = [20 * FRAME_NS + round(gap_s * 1e9) + k * FRAME_NS for k in range(len(after))]
    chosen = [branches.choose(7, solutions, now_ns) for solutions, now_ns in zip(after, at, strict=True)]
    return [(side(best), side(other)) for best, other in chosen]


def test_where_a_robot_may_have_passed_the_panel_unseen_the_frame_decides() -> None:
    """2 m away, from 20° to the left to 20° to the right in 0.45 s: 3 m/s, which a robot may do. Both, if it cannot."""
    assert after_a_gap(0.45, pair(60.0, 1.0))[0][0] == "right"
    assert None not in after_a_gap(0.45, pair(1.0, 1.5))[0]
    assert after_a_gap(0.45, pair(1.0, 60.0)) == [("left", None)]


def test_in_a_short_gap_no_robot_comes_to_the_other_side() -> None:
    """27 m/s: the memory holds, though the frame itself says little."""
    assert after_a_gap(0.05, pair(1.0, 1.5)) == [("left", None)]


def test_a_frame_that_contradicts_the_memory_has_both_told() -> None:
    """At once, however much is remembered, and however little it says."""
    assert after_a_gap(0.017, pair(1.5, 1.0)) == [("left", "right")]
    assert after_a_gap(0.017, pair(60.0, 1.0)) == [("left", "right")]


def test_two_panels_of_one_id_do_not_share_a_past() -> None:
    """From one frame to the next the camera is seen from a place where no robot can have come: it is another panel.

    Where it is just the place of the first one's mirror pose, its own evidence contradicts what is remembered.
    """
    assert after_a_gap(0.017, pair(3.0, 1.0, angle_deg=50.0)) == [("right", "left")]
    assert after_a_gap(0.017, pair(20.0, 1.0)) == [("left", "right")]


def test_panels_do_not_share_a_past() -> None:
    """Another ID begins anew."""
    branches = Branches()
    branches.choose(7, pair(1.0, 9.0), FRAME_NS)
    best, _ = branches.choose(8, pair(2.0, 1.0), 2 * FRAME_NS)
    assert side(best) == "right"


def test_a_panel_that_hangs_upright_does_not_lean() -> None:
    """Seen from below, the mirror image leans by 30°. Known to hang upright, that is excluded."""
    leaning, upright = yawed(0.0, 1.0, leans_deg=30.0), yawed(0.0, 2.0)
    best, other = Branches().choose(7, (leaning, upright), FRAME_NS)
    assert best is leaning
    assert other is upright
    best, other = Branches(UP).choose(7, (leaning, upright), FRAME_NS)
    assert best is upright
    assert other is None


def test_hanging_upright_says_nothing_of_left_and_right() -> None:
    """Both poses are upright: both are told."""
    assert watched([pair(1.0, 2.0)], Branches(UP)) == [("left", "right")]
