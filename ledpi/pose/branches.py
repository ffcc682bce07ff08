"""Which of a square's two poses to believe: by this frame, the frames before it, and that panels hang upright."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ledpi.core.records import MAX_GAP_NS, Floats, PlanarSolution
from ledpi.pose.planar import Solutions

# Standard deviations of what is not known of its velocity: no wheeled robot that looks for panels is quicker.
MAX_SPEED_M_S, MAX_TURN_RAD_S = 3.0, 6.0
# The other solution is excluded where it is a thousand times less likely: 2·ln 1000 of χ².
EXCLUDED_BY = 13.8
# The most that one frame may say. Half of it is enough in a first frame; but what was preferred for n frames is given
# up over several, in which both poses are reported.
MAX_CHI2_PER_FRAME = 2 * EXCLUDED_BY
# The mean is over so many frames. It is a mean and no sum: what errs most in a corner (the lens, a bezel's gleam) errs
# alike from frame to frame, and ten looks at it are no more than one.
REMEMBERED = 16
ELSEWHERE = 16.3  # χ² of 3 that chance exceeds once in 1,000 times: a camera so far off sees another panel, or leapt
# How far a panel's upward axis may lean from the robot's: hung by eye, a robot on a doorstep or braking.
UPRIGHT_SIGMA_RAD = math.radians(5)


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """Which pose of a panel is preferred, and how much more than the other."""

    preferred: PlanarSolution
    other: PlanarSolution
    gap: float  # of χ²: twice the log odds of the preferred pose
    frames: float  # that it is the mean of, so far as they say anything of the present
    seen_ns: int


class Branches:
    """One stream's panels. `up_in_camera` (3,) is given where they are known to hang upright."""

    def __init__(self, up_in_camera: Floats | None = None) -> None:
        self._up = None if up_in_camera is None else tuple(up_in_camera.tolist())
        self._hypotheses: dict[int, Hypothesis] = {}

    def choose(self, marker_id: int, solutions: Solutions, now_ns: int) -> tuple[PlanarSolution, PlanarSolution | None]:
        """The pose to believe, and the other one where the frames so far, or this one, do not exclude it.

        The belief never changes without both being reported: while they change places neither is excluded.
        """
        past = self._hypotheses.pop(marker_id, None)
        if len(solutions) == 1:
            return solutions[0], None
        first, second = solutions
        kept, mean, frames = 0.0, 0.0, 0.0
        if past is not None and 0 < now_ns - past.seen_ns <= MAX_GAP_NS:
            odds = _log_odds_of_continuing(past, first, second, (now_ns - past.seen_ns) * 1e-9)
            if odds < 0.0:
                first, second = second, first
            kept, mean, frames = math.tanh(0.5 * abs(odds)), past.gap, past.frames
        said = self._gap(first, second)
        gap, frames = _updated(kept, mean, frames, said)
        if gap < 0.0:
            first, second, gap, said = second, first, -gap, -said
        self._hypotheses[marker_id] = Hypothesis(first, second, gap, frames, now_ns)
        return first, second if gap < EXCLUDED_BY or said < 0.0 else None

    def _gap(self, first: PlanarSolution, second: PlanarSolution) -> float:
        gap = second.chi2 - first.chi2
        if self._up is not None:
            gap += (self._lean2(second) - self._lean2(first)) / UPRIGHT_SIGMA_RAD**2
        return max(-MAX_CHI2_PER_FRAME, min(MAX_CHI2_PER_FRAME, gap))

    def _lean2(self, solution: PlanarSolution) -> float:
        """Squared angle, rad², between the marker's y axis and up; the chord's, which is as good below 60°."""
        assert self._up is not None
        w, x, y, z = solution.camera_from_marker.quaternion_wxyz.tolist()
        axis = (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x))
        return math.fsum((a - b) ** 2 for a, b in zip(axis, self._up, strict=True))


def _updated(kept: float, mean: float, frames: float, said: float) -> tuple[float, float]:
    """The gap after a frame that said `said`, and the frames that it is the mean of.

    With the probability `kept` the past tells of these poses, and the frame is one more look of a mean; else it tells
    nothing, and the frame stands alone. So P = kept·P(mean) + (1 − kept)·P(said), of either pose.
    """
    mean += (said - mean) / (frames + 1.0)
    of_first = kept * _probability(mean), (1.0 - kept) * _probability(said)
    of_second = kept * _probability(-mean), (1.0 - kept) * _probability(-said)
    gap = 2.0 * math.log(sum(of_first) / sum(of_second))
    by_mean, by_frame = of_first if gap >= 0.0 else of_second
    return gap, min(1.0 + frames * by_mean / (by_mean + by_frame), REMEMBERED - 1.0)


def _probability(gap: float) -> float:
    """Probability of the pose whose χ² is less than the other's by `gap`."""
    return 1.0 / (1.0 + math.exp(-0.5 * gap))


def _log_odds_of_continuing(past: Hypothesis, first: PlanarSolution, second: PlanarSolution, elapsed_s: float) -> float:
    """ln(P(`first` continues the past's preferred pose) / P(`second` does)); 0 where neither can.

    Compared is where the camera is before the panel, which a turn of the camera does not change. A robot's way since
    then is normal with MAX_SPEED_M_S; so, after the time that it takes from one place to the other, the odds are even.
    """
    before, other, one, two = (_camera_in_marker(s) for s in (past.preferred, past.other, first, second))
    covariance = first.camera_from_marker.covariance
    assert covariance is not None
    arm2 = math.fsum(x * x for x in one)
    variance = (MAX_SPEED_M_S * elapsed_s) ** 2 + arm2 * math.fsum(covariance.diagonal().tolist()[3:])
    continued = 0.5 * (_apart2(before, one) + _apart2(other, two)) / variance
    exchanged = 0.5 * (_apart2(before, two) + _apart2(other, one)) / variance
    return 0.5 * (exchanged - continued) if min(continued, exchanged) < ELSEWHERE else 0.0


def _camera_in_marker(solution: PlanarSolution) -> tuple[float, float, float]:
    """The camera's place in `marker`, m: −Rᵀ·t."""
    w, x, y, z = solution.camera_from_marker.quaternion_wxyz.tolist()
    a, b, c = solution.camera_from_marker.position_m.tolist()
    return (
        -(1 - 2 * (y * y + z * z)) * a - 2 * (x * y + w * z) * b - 2 * (x * z - w * y) * c,
        -2 * (x * y - w * z) * a - (1 - 2 * (x * x + z * z)) * b - 2 * (y * z + w * x) * c,
        -2 * (x * z + w * y) * a - 2 * (y * z - w * x) * b - (1 - 2 * (x * x + y * y)) * c,
    )


def _apart2(a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
    """Squared distance, m²."""
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
