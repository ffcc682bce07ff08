"""An extended Kalman filter of the robot's pose and of what each panel errs by in every frame alike.

The state is the own part (inputs.py); how far the camera is turned about x, y and z of base_link from where
robot.camera_mount has it; then for each of at most eight panels dx, dy and dyaw of its place in the map, and the share
by which it is seen too far. The place has the map's deviations as prior. What the decoder sees wrong of a panel lasts
for seconds, too: the share, and a part of dyaw, are Gauss-Markov processes. So a thousand frames of one panel do not
average them away. (Schmidt, 1966, only considers such numbers; estimated, they tell what a map and a mount have wrong.)
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass

import numpy as np

from ledpi.core.records import Floats, PanelMap
from ledpi.state.inputs import (
    DRIFT,
    MEASURED_SPEED,
    MEASURED_TURN,
    OWN,
    POSE,
    PRIORS,
    SPEED,
    TURN,
    WAY_SCALE,
    YAW,
    YAW_SCALE,
    Look,
    Step,
    X,
    Y,
    propagate,
    wrapped,
)

DX, DY, DYAW, RANGE = range(4)
EACH, MOST_PANELS = 4, 8
ROLL, PITCH, TURNED = range(OWN, OWN + 3)
FIRST = OWN + 3  # of the panels' numbers
SIZE = FIRST + EACH * MOST_PANELS
MOUNT_RAD = math.radians(1.0)  # deviation of a camera's mount, about each axis

GATE = {2: 13.8, 3: 16.3}  # χ² by degrees of freedom that chance exceeds once in 1,000 times
MIRROR_LEAD = 9.0  # χ² by which one of two mirror poses must lead: 90 to 1
RANGE_FADES_S, HEADING_FADES_S = 5.0, 2.0  # time constants of the two processes
CONTRADICTS = 4.0  # deviations of a prior beyond which the map is wrong
LOST_M, LOST_RAD = 3.0, 0.5  # deviations of a pose that is none: over such angles no equation is straight


@dataclass(frozen=True, slots=True, eq=False)
class Innovation:
    """A look beside what the state predicts of it."""

    error: Floats  # (n,): n = 3, or 2 where only the place is compared
    covariance: Floats  # (n, n) of `error`
    cross: Floats  # (n, SIZE) H·P

    @property
    def chi2(self) -> float:
        return float(self.error @ np.linalg.solve(self.covariance, self.error))


@dataclass(frozen=True, slots=True, eq=False)
class _Slot:
    """A panel's place in the state, when it was seen, and its deviations before anything is known."""

    at: int
    seen_ns: int
    priors: Floats  # (EACH,)


class Filter:
    """State and covariance, changed in place. `seat`: x and y of base_link_from_camera."""

    def __init__(self, panels: PanelMap, seat: tuple[float, float]) -> None:
        self._places = {i: tuple(p.map_from_marker[:2, 3].tolist()) for i, p in panels.items()}
        self._deviations = {i: (p.position_sigma_m, p.angle_sigma_rad) for i, p in panels.items()}
        self._seat, self.slots, self.has_pose = seat, dict[int, _Slot](), False
        self._turn_priors: tuple[float, float] | None = None  # of what measures the yaw, since it does
        self.x, self.P = np.zeros(SIZE), np.diag(np.square([*PRIORS, *[MOUNT_RAD] * 3, *[0.0] * (SIZE - FIRST)]))

    def copy(self) -> Filter:
        other = copy(self)
        other.x, other.P, other.slots = self.x.copy(), self.P.copy(), self.slots.copy()
        return other

    def ahead(self) -> Filter:
        """Copies what is not of panels: enough to look ahead, and less to copy and to move."""
        other = copy(self)
        other.x, other.P = self.x[:FIRST].copy(), self.P[:FIRST, :FIRST].copy()
        return other

    @property
    def pose(self) -> Floats:
        return self.x[:POSE].copy()

    @property
    def covariance(self) -> Floats:
        return self.P[:POSE, :POSE].copy()

    @property
    def mount(self) -> Floats:
        """(2, 3): how far the camera is turned about x, y and z of base_link, and the deviations, in radians."""
        return np.stack([self.x[OWN:FIRST], np.sqrt(self.P.diagonal()[OWN:FIRST])])

    def move_like(self, other: Filter) -> None:
        """Takes over what another knows of the motion, of odometry, and of the camera's mount."""
        self._turn_priors = other._turn_priors
        self.x[POSE:FIRST] = other.x[POSE:FIRST]
        self.P[POSE:FIRST, POSE:FIRST] = other.P[POSE:FIRST, POSE:FIRST]

    def propagate(self, step: Step) -> None:
        if step.turn_rad is not None and step.turn_priors != self._turn_priors:  # a drift of what measured it before
            self._turn_priors = step.turn_priors
            for at, deviation in zip((DRIFT, YAW_SCALE), step.turn_priors, strict=True):
                self.x[at], self.P[at], self.P[:, at] = 0.0, 0.0, 0.0
                self.P[at, at] = deviation**2
        propagate(self.x, self.P, step)
        if self.P[X, X] + self.P[Y, Y] > LOST_M**2 or self.P[YAW, YAW] > LOST_RAD**2:
            self.has_pose = False

    def start(self, look: Look) -> None:
        """Begins anew at the pose that one panel gives, correlated with what is not known of the panel and the mount.

        yaw = z₃ + dyaw − turned; x, y = m + d − R(yaw)·(seat + v), where v (`_seen`) is the panel from the camera.
        """
        at, seat = self._slot(look), np.array(self._seat)
        seen, by_seen = self._seen(look, at)
        yaw = wrapped(seen[2])
        turn = _rotation(yaw)
        arm = turn @ (seat + seen[:2])
        slopes = np.vstack([-turn @ by_seen[:2], by_seen[2:]])
        slopes[:2] += np.outer([arm[1], -arm[0]], by_seen[2])
        by_look = np.eye(3)
        by_look[:2, :2], by_look[:2, 2] = -turn, (arm[1], -arm[0])
        slopes[:2, 3:5] += np.eye(2)
        others = [ROLL, PITCH, TURNED, *range(at, at + EACH)]
        self.x[:POSE] = *(self._places[look.panel] + self.x[at : at + 2] - arm), yaw
        self.P[:POSE] = slopes @ self.P[others]
        self.P[:, :POSE] = self.P[:POSE].T
        self.P[:POSE, :POSE] = self.P[:POSE, others] @ slopes.T + by_look @ look.pose.covariance @ by_look.T
        self.has_pose = True

    def compare(self, look: Look) -> Innovation:
        """Compares a look with the state: the mirror pose that leads, or the place alone where neither does."""
        at = self._slot(look)
        predicted, H = self._predict(look, at)
        columns = [X, Y, YAW, ROLL, PITCH, TURNED, *range(at, at + EACH)]
        cross = H @ self.P[columns]
        spread = cross[:, columns] @ H.T
        found = []
        for pose in [look.pose] if look.alternate is None else [look.pose, look.alternate]:
            error = pose.value - predicted
            error[2] = wrapped(error[2])
            found.append(Innovation(error, spread + pose.covariance, cross))
        one, *others = found
        if others and abs(one.chi2 - others[0].chi2) < MIRROR_LEAD:
            return Innovation(one.error[:2], one.covariance[:2, :2], cross[:2])
        return min(found, key=lambda each: each.chi2) if others else one

    def update(self, innovation: Innovation) -> None:
        """Corrects the state: x += K·e, P −= K·S·Kᵀ with K = P·Hᵀ·S⁻¹; by a root of S⁻¹, so that P stays symmetric.

        A correction c moves the pose along an arc, r += sinc(a/2)·R(a/2)·c_xy, where a is how far it turns the camera,
        and turns P with it: how far the robot is off, as it sees it, stays. Else each correction of the yaw would make
        a distance tell something of it: the error of an invariant filter (Barrau & Bonnabel, IEEE Trans. Automatic
        Control, 2017). While the robot stands the mount is only considered (Schmidt): nothing tells it from the pose.
        """
        root = np.linalg.inv(np.linalg.cholesky(innovation.covariance))
        gain = root @ innovation.cross
        change = (root @ innovation.error) @ gain
        mount = self.P[OWN:FIRST, OWN:FIRST].copy()
        self.P -= gain.T @ gain
        if not self._moves:
            change[OWN:FIRST], self.P[OWN:FIRST, OWN:FIRST] = 0.0, mount
        turn = change[YAW] + change[TURNED]
        change[:2] = np.sinc(turn / math.tau) * _rotation(turn / 2) @ change[:2]
        self.x += change
        self.x[YAW] = wrapped(self.x[YAW])
        self.P[:2] = _rotation(turn) @ self.P[:2]
        self.P[:, :2] = self.P[:, :2] @ _rotation(turn).T

    @property
    def _moves(self) -> bool:
        return bool(abs(self.x[SPEED]) > MEASURED_SPEED or abs(self.x[TURN]) > MEASURED_TURN)

    def contradicts_map(self, panel: int) -> bool:
        """Tells whether a panel's place or share is beyond what the priors allow."""
        slot = self.slots[panel]
        return bool((np.abs(self.x[slot.at : slot.at + EACH]) > CONTRADICTS * slot.priors).any())

    @property
    def contradicts_mount(self) -> bool:
        """Tells whether the camera is turned by more than its prior allows."""
        return bool((np.abs(self.x[OWN:FIRST]) > CONTRADICTS * MOUNT_RAD).any())

    @property
    def contradicts_odometry(self) -> bool:
        """Tells whether a scale is beyond what its prior allows."""
        yaw = math.inf if self._turn_priors is None else self._turn_priors[1]
        return bool(
            abs(self.x[WAY_SCALE]) > CONTRADICTS * PRIORS[WAY_SCALE] or abs(self.x[YAW_SCALE]) > CONTRADICTS * yaw
        )

    def _seen(self, look: Look, at: int) -> tuple[Floats, Floats]:
        """The panel from the camera, and the heading, without what they err by; slopes by the mount's and panel's.

        v = R(turned)·((1 − range)·(z − seat) + above·(pitch, −roll)), and z₃ + dyaw − turned. Slopes are of what was
        seen, not of what is believed: else a belief that is wrong would have looks prove it.
        """
        z, above = look.pose.value[:2] - self._seat, look.above_m
        roll, pitch, turned = self.x[OWN:FIRST].tolist()
        dyaw, share = self.x[at + DYAW : at + EACH].tolist()
        turn = _rotation(turned)
        v = turn @ ((1.0 - share) * z + above * np.array([pitch, -roll]))
        slopes = np.zeros((3, 3 + EACH))
        slopes[:2, 0], slopes[:2, 1], slopes[:2, 2] = -above * turn[:, 1], above * turn[:, 0], (-v[1], v[0])
        slopes[:2, 3 + RANGE] = -turn @ z
        slopes[2, 2], slopes[2, 3 + DYAW] = -1.0, 1.0
        return np.array([*v, float(look.pose.value[2]) + dyaw - turned]), slopes

    def _predict(self, look: Look, at: int) -> tuple[Floats, Floats]:
        """The look at a panel that is predicted, and its slopes by x, y, yaw, the mount's three and the panel's four.

        q = R(−yaw)·(m + d − r) is its place in base_link; of a look z there is left z − v (`_seen`).
        """
        seen, by_seen = self._seen(look, at)
        (east, north), seat = self._places[look.panel], np.array([*self._seat, 0.0])
        x, y, yaw = self.x[:POSE].tolist()
        dx, dy = self.x[at : at + 2].tolist()
        c, s = math.cos(yaw), math.sin(yaw)
        east, north = east + dx - x, north + dy - y
        H = np.zeros((3, POSE + 3 + EACH))
        qx, qy = (seen[:2] + self._seat).tolist()
        H[:, :3] = [-c, -s, qy], [s, -c, -qx], [0.0, 0.0, 1.0]
        H[:, 3:] = -by_seen
        H[:2, 6:8] = [c, s], [-s, c]
        believed = np.array([c * east + s * north, c * north - s * east, yaw])
        return look.pose.value + believed - seat - seen, H

    def _slot(self, look: Look) -> int:
        """Returns where a panel's numbers are, aged to this look. The panel unseen longest leaves for a new one.

        dyaw is the map's and the decoder's, of variances m² and h²: one process of variance m² + h². That it diffuses
        as fast as the decoder's does within its time constant τ, 2·h²/τ a second, its rate is h²/(m² + h²)/τ.
        """
        slot = self.slots.get(look.panel)
        place, angle = self._deviations[look.panel]
        steady = np.array([math.hypot(angle, look.heading_rad), look.range_share])
        if slot is None:
            slot, fades = _Slot(self._make_room(), look.t_ns, np.array([place, place, *steady])), np.zeros(2)
            self.P[[slot.at + DX, slot.at + DY], [slot.at + DX, slot.at + DY]] = place**2
        else:
            rates = np.array([(look.heading_rad / steady[0]) ** 2 / HEADING_FADES_S, 1 / RANGE_FADES_S])
            fades = np.exp(-(look.t_ns - slot.seen_ns) * 1e-9 * rates)
        grown = (1 - fades**2) * steady**2
        priors = np.array([place, place, *np.sqrt((fades * slot.priors[DYAW:]) ** 2 + grown)])
        self.slots[look.panel] = _Slot(slot.at, look.t_ns, priors)
        two = slice(slot.at + DYAW, slot.at + EACH)
        self.x[two] *= fades
        self.P[two] *= fades[:, None]
        self.P[:, two] *= fades
        self.P[two, two] += np.diag(grown)
        return slot.at

    def _make_room(self) -> int:
        if len(self.slots) < MOST_PANELS:
            return FIRST + EACH * len(self.slots)
        at = self.slots.pop(min(self.slots, key=lambda panel: (self.slots[panel].seen_ns, panel))).at
        own = slice(at, at + EACH)
        self.x[own], self.P[own], self.P[:, own] = 0.0, 0.0, 0.0
        return at


def _rotation(angle: float) -> Floats:
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
