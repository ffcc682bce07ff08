"""WPILib's pose estimator (DifferentialDrivePoseEstimator of 2025), to compare with: the same odometry and fixes.

A fix moves the pose at its time by a gain that only two deviations decide, and not what is known by then:
K = q / (q + sqrt(q*r)) for each of x, y and yaw of the twist from one pose to the other. Written anew from its source.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from evaluation.drives.cases import PICTURE_LATE_NS, Drive, Fix
from evaluation.drives.robot import DT_S
from ledpi.core.records import Floats
from ledpi.state.inputs import wrapped

STATE = {"docs": (0.05, 0.05, math.radians(5)), "stated": (0.02, 0.02, 0.01)}
DOCS_FIX = (0.5, 0.5, math.radians(30))  # of its documentation; `stated`: those of each fix


def composed(one: Floats, two: Floats) -> Floats:
    """The pose `two` in the frame of `one`."""
    c, s = math.cos(one[2]), math.sin(one[2])
    x, y = one[0] + c * two[0] - s * two[1], one[1] + s * two[0] + c * two[1]
    return np.array([x, y, wrapped(one[2] + two[2])])


def between(one: Floats, two: Floats) -> Floats:
    """The pose that leads from `one` to `two`."""
    c, s = math.cos(one[2]), math.sin(one[2])
    x, y = two[:2] - one[:2]
    return np.array([c * x + s * y, c * y - s * x, wrapped(two[2] - one[2])])


def exp(twist: Floats) -> Floats:
    """The pose after a twist."""
    x, y, a = twist
    s, c = (1 - a * a / 6, a / 2) if abs(a) < 1e-9 else (math.sin(a) / a, (1 - math.cos(a)) / a)
    return np.array([s * x - c * y, c * x + s * y, a])


def log(pose: Floats) -> Floats:
    """The twist that leads to a pose."""
    x, y, a = pose
    half = a / 2
    k = 1 - a * a / 12 if abs(math.cos(a) - 1) < 1e-9 else -half * math.sin(a) / (math.cos(a) - 1)
    return np.array([k * x + half * y, k * y - half * x, a])


def errors(drive: Drive, fixes: Sequence[Fix], deviations: str, times: Sequence[float]) -> Floats:
    """(N, 3) errors at these times, from the first fix on; each fix arrives as late as a picture."""
    totals = np.array([each.totals for each in drive.odometry], float)
    steps = np.diff(totals, axis=0)
    odometry = [np.array([0.0, 0.0, totals[0, 2]])]
    for left, right, turn in steps.tolist():
        odometry.append(composed(odometry[-1], exp(np.array([(left + right) / 2, 0.0, turn]))))
    q, found, waiting = np.square(STATE[deviations]), [], list(fixes)[::-1]
    at = base = None  # the pose that the newest fix has left, and odometry's then
    for t_s in times:
        while waiting and waiting[-1].t_s + PICTURE_LATE_NS * 1e-9 <= t_s:
            fix = waiting.pop()
            then = odometry[round(fix.t_s / DT_S)]
            if at is None or base is None:
                at, base = fix.pose, then
                continue
            r = np.diag(fix.covariance) if deviations == "stated" else np.square(DOCS_FIX)
            sample = composed(at, between(base, then))
            twist = log(between(sample, fix.pose))
            at, base = composed(sample, exp(q / (q + np.sqrt(q * r)) * twist)), then
        if at is not None and base is not None:
            error = composed(at, between(base, odometry[round(t_s / DT_S)])) - drive.way.pose(t_s)
            error[2] = wrapped(error[2])
            found.append(error)
    return np.array(found)
