"""Which of a square's two poses to believe: by this frame, the frames before it, and that panels hang upright."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ledpi.core.records import MAX_GAP_NS, Floats, PlanarSolution
from ledpi.pose.planar import Solutions

# The other solution is excluded where it is a thousand times less likely: 2·ln 1000 of χ².
EXCLUDED_BY = 13.8
# The most that one frame may say. Half of it is enough in a first frame; but what was preferred for n frames is given
# up over several, in which both poses are reported.
MAX_CHI2_PER_FRAME = 2 * EXCLUDED_BY
# The mean is over so many frames. It is a mean and no sum: what errs most in a corner (the lens, a bezel's gleam) errs
# alike from frame to frame, and ten looks at it are no more than one.
REMEMBERED = 16
APART = 3.0  # standard deviations: nearer solutions cannot be distinguished from one frame to the next
# How far a panel's upward axis may lean from the robot's: hung by eye, a robot on a doorstep or braking.
UPRIGHT_SIGMA_RAD = math.radians(5)


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """Which pose of a panel is preferred, and how much more than the other."""

    preferred: PlanarSolution
    other: PlanarSolution
    gap: float  # mean over the frames of the other's χ² less that of the preferred
    frames: int
    seen_ns: int


class Branches:
    """One stream's panels. `up_in_camera` (3,) is given where they are known to hang upright."""

    def __init__(self, up_in_camera: Floats | None = None) -> None:
        self._up = None if up_in_camera is None else tuple(up_in_camera.tolist())
        self._hypotheses: dict[int, Hypothesis] = {}

    def choose(self, marker_id: int, solutions: Solutions, now_ns: int) -> tuple[PlanarSolution, PlanarSolution | None]:
        """The pose to believe, and the other one where it cannot be excluded.

        The belief never changes without both being reported: while they change places neither is excluded.
        """
        past = self._hypotheses.pop(marker_id, None)
        if len(solutions) == 1:
            return solutions[0], None
        first, second = solutions
        gap, frames = 0.0, 0
        if past is not None and 0 < now_ns - past.seen_ns <= MAX_GAP_NS and _are_distinct(first, second):
            gap, frames = past.gap, past.frames
            if _discontinuity(past, second, first) < _discontinuity(past, first, second):
                first, second = second, first
        gap += (self._gap(first, second) - gap) / (frames + 1)
        if gap < 0:
            first, second, gap = second, first, -gap
        self._hypotheses[marker_id] = Hypothesis(first, second, gap, min(frames + 1, REMEMBERED - 1), now_ns)
        return first, second if gap < EXCLUDED_BY else None

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


def _are_distinct(first: PlanarSolution, second: PlanarSolution) -> bool:
    covariance = first.camera_from_marker.covariance
    assert covariance is not None
    turn2: float = sum(covariance.diagonal().tolist()[3:])
    return _angle2(first, second) > APART**2 * turn2


def _discontinuity(past: Hypothesis, preferred: PlanarSolution, other: PlanarSolution) -> float:
    """How badly two solutions continue the past ones. A turn of the camera, common to both, makes no difference."""
    return _angle2(past.preferred, preferred) + _angle2(past.other, other)


def _angle2(a: PlanarSolution, b: PlanarSolution) -> float:
    """Squared angle between two rotations, rad²."""
    aw, ax, ay, az = a.camera_from_marker.quaternion_wxyz.tolist()
    bw, bx, by, bz = b.camera_from_marker.quaternion_wxyz.tolist()
    dot: float = aw * bw + ax * bx + ay * by + az * bz
    return 4.0 * math.acos(min(1.0, abs(dot))) ** 2
