"""The drives: what goes wrong in each, and what the state made of it, message by message."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from evaluation.drives.looks import Looks, turned_about_camera
from evaluation.drives.robot import BASE_FROM_CAMERA, BASE_M, DT_S, MIDDLE, PANELS, Way, drive, map_of, odometry
from ledpi.core.records import Floats
from ledpi.state.estimator import Estimator, State
from ledpi.state.filter import Filter
from ledpi.state.inputs import Look, Odometry, OdometryNoise, wrapped

MAP_M, MAP_RAD = 0.010, math.radians(1.0)
HIDDEN = 0.10  # of the frames
FRAMES_HZ, REPORTS_HZ = 20.0, 10.0  # more frames say nothing new
PICTURE_LATE_NS, ODOMETRY_LATE_NS = 60_000_000, 3_000_000
MOVED_M = 0.3
CARRIED_S = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A kind of drive."""

    name: str
    seconds: float = 60.0
    odometry: str = "gyro"  # gyro: wheels and gyro; wheels: alone; turns: a gyro alone; none
    dark: tuple[tuple[float, float], ...] = ()  # seconds without a panel, from and to
    carried: bool = False  # turned about the room's middle
    moved: str = ""  # a panel hangs elsewhere: `later`: than those that the state rests on; `first`: it begins there
    late_s: float = 0.0  # error of the pictures' clock
    mount_deg: float = 0.0  # by which the camera looks to the left of where robot.camera_mount says


CASES = {
    case.name: case
    for case in (
        Case(name="plain"),
        Case(name="gaps", seconds=41, dark=((15, 20), (35, 40))),
        Case(name="gaps_wheels", seconds=41, dark=((15, 20), (35, 40)), odometry="wheels"),
        Case(name="turns", odometry="turns"),
        Case(name="none", odometry="none"),
        Case(name="carried", seconds=40, carried=True),
        Case(name="moved", seconds=60, moved="later"),
        Case(name="moved_first", seconds=60, moved="first"),
        Case(name="clock", late_s=0.010),
        Case(name="mount", mount_deg=1.0),
    )
}


@dataclass(frozen=True, slots=True)
class Message:
    """A report beside the truth."""

    t_s: float
    true: Floats
    state: State

    @property
    def error(self) -> Floats:
        error = self.state.pose - self.true
        error[2] = wrapped(error[2])
        return error

    @property
    def nees(self) -> float:
        """Normalised estimation error squared, of three degrees of freedom."""
        return float(self.error @ np.linalg.solve(self.state.covariance, self.error))


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """A drive before anything estimates it."""

    way: Way
    odometry: list[Odometry]
    frames: list[tuple[float, list[Look]]]
    mapped: dict[int, Floats]
    moved: int | None = None
    untouched: Drive | None = None  # the same without the panel's being moved


@dataclass(frozen=True, slots=True, eq=False)
class Driven:
    """A drive, and what was reported."""

    drive: Drive
    messages: list[Message]
    rejected: int


@dataclass(frozen=True, slots=True, eq=False)
class Fix:
    """A pose by one frame."""

    t_s: float
    pose: Floats
    covariance: Floats


def drive_of(case: Case, seed: int, frames_hz: float = FRAMES_HZ) -> Drive:
    """Draws a drive: truth, odometry, and looks at panels that do not hang quite where the map has them."""
    rng = np.random.default_rng([seed, 51])
    way = drive(rng, case.seconds)
    totals = odometry(rng, way)
    mapped = {i: np.array([x, y, math.radians(yaw)]) for i, (x, y, yaw) in PANELS.items()}
    hung = {i: at + rng.normal(0, [MAP_M, MAP_M, MAP_RAD]) for i, at in mapped.items()}
    if case.carried:
        k = round(CARRIED_S / DT_S)
        way.poses[k:, :2] = 2 * MIDDLE - way.poses[k:, :2]
        way.poses[k:, 2] = (way.poses[k:, 2] + 2 * math.pi) % (2 * math.pi) - math.pi
    luck = rng.integers(1 << 32)
    frames = _frames(case, way, (hung, mapped), luck, frames_hz)
    untouched = Drive(way, totals, frames, mapped)
    moved = _chosen(case, frames)
    if moved is None:
        return untouched
    x, y, yaw = hung[moved]
    aside = MOVED_M * rng.choice([-1.0, 1.0])
    hung[moved] = np.array([x - aside * math.sin(yaw), y + aside * math.cos(yaw), yaw])
    return Drive(way, totals, _frames(case, way, (hung, mapped), luck, frames_hz), mapped, moved, untouched)


def _frames(
    case: Case, way: Way, panels: tuple[dict[int, Floats], dict[int, Floats]], luck: int, frames_hz: float
) -> list[tuple[float, list[Look]]]:
    rng = np.random.default_rng(luck)
    looks = Looks(rng, *panels, HIDDEN)
    begins = rng.uniform(0, 1 / frames_hz)
    times = [float(t) for t in np.arange(begins + 0.02, case.seconds, 1 / frames_hz)]
    mount_rad = math.radians(case.mount_deg)
    seen = [(t, looks.frame(t, turned_about_camera(way.pose(t), mount_rad))) for t in times]
    return [(t, each) for t, each in seen if not any(a <= t < b for a, b in case.dark)]


def _chosen(case: Case, frames: list[tuple[float, list[Look]]]) -> int | None:
    """The panel that is moved: the first that leaves no choice, or the third, after the state has rested on two."""
    order = dict.fromkeys(look.panel for _, looks in frames for look in looks if look.alternate is None)
    number = {"first": 0, "later": 2}.get(case.moved)
    return list(order)[number] if number is not None and len(order) > number else None


def noise_of(case: Case) -> OdometryNoise:
    return OdometryNoise(base_m=BASE_M) if case.odometry == "wheels" else OdometryNoise()


def estimator_of(case: Case, drive: Drive) -> Estimator:
    return Estimator(map_of(drive.mapped, MAP_M, MAP_RAD), BASE_FROM_CAMERA, noise_of(case))


def heard(case: Case, odometry: Odometry) -> Odometry:
    """The part of the odometry that the case has."""
    if case.odometry == "turns":
        return replace(odometry, left_m=None, right_m=None)
    return replace(odometry, yaw_rad=None) if case.odometry == "wheels" else odometry


def run(case: Case, drive: Drive, reports_hz: float = REPORTS_HZ) -> Driven:
    """Hands everything over at the time at which it arrives, and asks for the state."""
    estimator, messages, rejected = estimator_of(case, drive), [], 0
    late_ns = PICTURE_LATE_NS + round(case.late_s * 1e9)
    arrivals: list[tuple[int, Odometry | Look]] = []
    if case.odometry != "none":
        arrivals += [(each.t_ns + ODOMETRY_LATE_NS, heard(case, each)) for each in drive.odometry]
    for look in (look for _, looks in drive.frames for look in looks):
        arrivals.append((look.t_ns + late_ns, replace(look, t_ns=look.t_ns + round(case.late_s * 1e9))))
    arrivals.sort(key=lambda each: -each[0])
    for t_s in np.arange(1 / reports_hz, case.seconds - 0.05, 1 / reports_hz).tolist():
        now_ns = round(t_s * 1e9)
        while arrivals and arrivals[-1][0] <= now_ns:
            arrived_ns, what = arrivals.pop()
            add = (
                estimator.add_look(what, arrived_ns)
                if isinstance(what, Look)
                else estimator.add_odometry(what, arrived_ns)
            )
            rejected += add is not None
        state = estimator.at(now_ns)
        if isinstance(state, State):
            messages.append(Message(t_s, drive.way.pose(state.t_ns * 1e-9), state))
    return Driven(drive, messages, rejected)


def raw_fixes(case: Case, drive: Drive) -> list[Fix]:
    """Fixes of single frames: the poses by each panel that leaves no choice, weighed."""
    panels, fixes = map_of(drive.mapped, MAP_M, MAP_RAD), []
    seat = float(BASE_FROM_CAMERA[0, 3]), float(BASE_FROM_CAMERA[1, 3])
    for t_s, looks in drive.frames:
        weights, weighed, first = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
        for look in looks:
            if look.alternate is None:
                alone = Filter(panels, seat)
                alone.start(look)
                weight = np.linalg.inv(alone.covariance)
                first = first if weights.any() else alone.pose
                apart = alone.pose - first
                apart[2] = wrapped(apart[2])
                weights += weight
                weighed += weight @ apart
        if weights.any():
            covariance = np.linalg.inv(weights)
            fixes.append(Fix(t_s, first + covariance @ weighed, covariance))
    return fixes
