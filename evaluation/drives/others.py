"""Estimators that the state is compared with: WPILib's, and the causal optimum.

WPILib's is DifferentialDrivePoseEstimator of 2025, on the same odometry and fixes. A fix moves the pose at its time by
a gain that only two deviations decide, and not what is known by then: K = q / (q + sqrt(q*r)) for each of x, y and yaw
of the twist from one pose to the other. Written anew from its source.

The causal optimum has of all data until then the poses and errors that are likeliest by the filter's own model:
Gauss-Newton over a pose each 0.1 s, odometry's drift and scales, and of each panel its place and, each second, its
share and heading. It is told which of two mirror poses is the true one, and nothing arrives late.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from operator import attrgetter
from typing import Any

import numpy as np

from evaluation.drives.cases import CASES, MAP_M, MAP_RAD, PICTURE_LATE_NS, Drive, Fix, drive_of, estimator_of, noise_of
from evaluation.drives.robot import BASE_FROM_CAMERA, DT_S
from ledpi.core.records import Floats
from ledpi.state.estimator import State
from ledpi.state.filter import HEADING_FADES_S, RANGE_FADES_S
from ledpi.state.inputs import GYRO_PRIORS, PRIORS, SIDEWAYS, WAY_SCALE, Look, Odometry, between, step_between, wrapped

STATE = {"docs": (0.05, 0.05, math.radians(5)), "stated": (0.02, 0.02, 0.01)}
DOCS_FIX = (0.5, 0.5, math.radians(30))  # of its documentation; `stated`: those of each fix


def composed(one: Floats, two: Floats) -> Floats:
    """The pose `two` in the frame of `one`."""
    c, s = math.cos(one[2]), math.sin(one[2])
    x, y = one[0] + c * two[0] - s * two[1], one[1] + s * two[0] + c * two[1]
    return np.array([x, y, wrapped(one[2] + two[2])])


def pose_between(one: Floats, two: Floats) -> Floats:
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


def wpilib_errors(drive: Drive, fixes: Sequence[Fix], deviations: str, times: Sequence[float]) -> Floats:
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
            sample = composed(at, pose_between(base, then))
            twist = log(pose_between(sample, fix.pose))
            at, base = composed(sample, exp(q / (q + np.sqrt(q * r)) * twist)), then
        if at is not None and base is not None:
            error = composed(at, pose_between(base, odometry[round(t_s / DT_S)])) - drive.way.pose(t_s)
            error[2] = wrapped(error[2])
            found.append(error)
    return np.array(found)


CASE = CASES["plain"]
UNTIL_S = (10.0, 20.0, 30.0)
EACH_FRAME, BIN_S, ITERATIONS = 2, 1.0, 5  # of 20 a second
SEAT = BASE_FROM_CAMERA[:2, 3]


def judge_optimum(seed: int) -> dict[str, float]:
    """The RMS of both, at some moments of a drive, in mm."""
    drive = drive_of(CASE, seed)
    filtered = filtered_poses(drive)
    by: dict[str, list[float]] = {"batch_mm": [], "causal_mm": []}
    for end_s in UNTIL_S:
        nodes = [k for k in filtered if drive.frames[k][0] <= end_s]
        true = drive.way.pose(drive.frames[nodes[-1]][0])
        for name, pose in (("batch_mm", until(drive, filtered, nodes)), ("causal_mm", filtered[nodes[-1]])):
            by[name].append(1e3 * math.hypot(*(pose - true)[:2]))
    return {name: float(np.sqrt(np.mean(np.square(each)))) for name, each in by.items()}


def filtered_poses(drive: Drive) -> dict[int, Floats]:
    """The state's poses, by the number of the frame."""
    estimator, poses, k = estimator_of(CASE, drive), {}, 0
    for number in range(0, len(drive.frames), EACH_FRAME):
        t_s, looks = drive.frames[number]
        t_ns = round(t_s * 1e9)
        while drive.odometry[k].t_ns <= t_ns + 10_000_000:
            estimator.add_odometry(drive.odometry[k], t_ns)
            k += 1
        for look in looks:
            estimator.add_look(look, t_ns)
        state = estimator.at(t_ns)
        if isinstance(state, State):
            poses[number] = state.pose
        if t_s > UNTIL_S[-1]:
            break
    return poses


def odometry_at(drive: Drive, t_s: float) -> Odometry:
    t_ns = round(t_s * 1e9)
    k = bisect_right(drive.odometry, t_ns, key=attrgetter("t_ns"))
    return between(drive.odometry[k - 1], drive.odometry[k], t_ns)


@dataclass
class Problem:
    """Unknowns and squared errors; each term is what a function of some unknowns should be."""

    x: Floats
    known: dict[object, slice] = field(default_factory=dict)
    seen: dict[int, int | None] = field(default_factory=dict)  # the newest second of each panel's errors

    def unknown(self, name: object, value: Floats) -> bool:
        """Adds one, if it is new."""
        if name in self.known:
            return False
        self.known[name] = slice(len(self.x), len(self.x) + len(value))
        self.x = np.concatenate([self.x, value])
        return True


def until(drive: Drive, start: dict[int, Floats], nodes: list[int]) -> Floats:
    """The likeliest pose at the last of these frames; `start` are poses to begin with."""
    problem, terms = Problem(np.zeros(0)), list[Any]()
    drift, yaw_scale = GYRO_PRIORS
    problem.unknown("odometry", np.zeros(3))
    priors = np.diag([drift, PRIORS[WAY_SCALE], yaw_scale]) ** 2
    terms.append((("odometry",), lambda o: (o, np.eye(3)), priors))
    for k in nodes:
        problem.unknown(k, start[k])
        for look in drive.frames[k][1]:
            add_look(problem, terms, drive, look, k)
    for one, two in pairwise(nodes):
        step = step_between(*(odometry_at(drive, drive.frames[k][0]) for k in (one, two)), noise_of(CASE))
        assert step.way_m is not None
        assert step.turn_rad is not None
        variances = [step.way_variance + 1e-8, SIDEWAYS**2 * step.way_variance + 1e-8, step.yaw_variance]
        terms.append(((one, two, "odometry"), moved(step.way_m, step.turn_rad, step.dt_s), np.diag(variances)))
    for _ in range(ITERATIONS):
        A, b = np.zeros((len(problem.x), len(problem.x))), np.zeros(len(problem.x))
        for names, function, covariance in terms:
            error, slopes = function(*(problem.x[problem.known[name]] for name in names))
            at = np.concatenate([np.arange(len(problem.x))[problem.known[name]] for name in names])
            weighed = slopes.T @ np.linalg.inv(covariance)
            A[np.ix_(at, at)] += weighed @ slopes
            b[at] -= weighed @ error
        problem.x += np.linalg.solve(A, b)
    return problem.x[problem.known[nodes[-1]]]


def moved(way: float, turn: float, dt_s: float) -> Any:
    """The error of two poses and odometry's drift and scales: along, across, yaw; and its slopes."""

    def error(one: Floats, two: Floats, odometry: Floats) -> tuple[Floats, Floats]:
        a, w = turn * (1 + odometry[2]) - odometry[0] * dt_s, way * (1 + odometry[1])
        c, s = math.cos(one[2] + a / 2), math.sin(one[2] + a / 2)
        along, across = np.array([[c, s], [-s, c]]) @ (two[:2] - one[:2])
        by_heading = np.array([across, -along])
        slopes = np.zeros((3, 9))
        slopes[:2, :2], slopes[:2, 3:5] = [[-c, -s], [s, -c]], [[c, s], [-s, c]]
        slopes[:2, 2], slopes[:2, 6], slopes[:2, 8] = by_heading, -dt_s / 2 * by_heading, turn / 2 * by_heading
        slopes[0, 7] = -way
        slopes[2, [2, 5, 6, 8]] = -1.0, 1.0, dt_s, -turn
        return np.array([along - w, across, wrapped(two[2] - one[2] - a)]), slopes

    return error


def add_look(problem: Problem, terms: list[Any], drive: Drive, look: Look, k: int) -> None:
    """The look's own error, and that of its panel's errors beside what they were in an earlier second."""
    panel, second = look.panel, int(look.t_ns * 1e-9 / BIN_S)
    place, now = (panel, "place"), (panel, second)
    if problem.unknown(place, np.zeros(2)):
        terms.append(((place,), lambda d: (d, np.eye(2)), MAP_M**2 * np.eye(2)))
        problem.seen[panel] = None
    if problem.unknown(now, np.zeros(2)):  # heading and share
        steady = np.array([math.hypot(MAP_RAD, look.heading_rad), look.range_share])
        rates = np.array([(look.heading_rad / steady[0]) ** 2 / HEADING_FADES_S, 1 / RANGE_FADES_S])
        before, problem.seen[panel] = problem.seen[panel], second
        if before is None:
            terms.append(((now,), lambda e: (e, np.eye(2)), np.diag(steady**2)))
        else:
            keeps = np.exp(-(second - before) * BIN_S * rates)
            slopes, spread = np.hstack([-np.diag(keeps), np.eye(2)]), np.diag((1 - keeps**2) * steady**2)
            terms.append((((panel, before), now), lambda a, b: (slopes @ np.concatenate([a, b]), slopes), spread))
    true = drive.way.pose(look.t_ns * 1e-9)
    poses = [look.pose] if look.alternate is None else [look.pose, look.alternate]
    pose = min(poses, key=lambda each: abs(wrapped(each.value[2] - true[2])))
    terms.append(((k, place, now), seen(drive.mapped[panel], pose.value), pose.covariance))


def seen(mapped: Floats, value: Floats) -> Any:
    """The error of a look by the robot's pose, the panel's place, its heading and share; and its slopes."""

    def error(at: Floats, d: Floats, e: Floats) -> tuple[Floats, Floats]:
        c, s, g = math.cos(at[2]), math.sin(at[2]), 1 + e[1]
        turn = np.array([[c, s], [-s, c]])
        q = turn @ (mapped[:2] + d - at[:2])
        slopes = np.zeros((3, 7))
        slopes[:2, :2], slopes[:2, 3:5] = -g * turn, g * turn
        slopes[:2, 2], slopes[:2, 6] = g * np.array([q[1], -q[0]]), q - SEAT
        slopes[2, [2, 5]] = 1.0, -1.0
        found = np.array([*(SEAT + g * (q - SEAT)), at[2] - e[0]]) - value
        found[2] = wrapped(found[2])
        return found, slopes

    return error
