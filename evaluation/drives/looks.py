"""Looks at panels, as erring as the decoder's in five rendered drives, and for as long alike.

What was found there, by distance (m): stated deviations and their spread, which looks are ambiguous, which panels are
not read, and the true errors' deviations and autocorrelation. The range is seen too far by half a per cent; its error
is the same after 50 ms to 0.92, the heading's to 0.6, that across to 0.75.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from evaluation.drives.robot import BASE_FROM_CAMERA, HEIGHT_M, is_in_view, place
from ledpi.core.geometry import inverse, matrix_from_rpy_deg, transform
from ledpi.core.records import Floats
from ledpi.state.inputs import Look, split_noise, wrapped

DISTANCES = (0.5, 1.25, 2.25, 2.75, 3.25, 3.75, 4.5, 6.0)
ALONG_M = (0.00055, 0.0018, 0.0145, 0.029, 0.040, 0.049, 0.063, 0.078)  # stated
ACROSS_M = (0.00005, 0.0001, 0.00035, 0.0005, 0.0006, 0.00075, 0.0009, 0.001)
HEADING_DEG = (0.3, 0.37, 0.7, 0.85, 0.9, 1.0, 1.1, 1.6)
FRONTAL_TWICE_DEG = 15.0  # below this incidence the heading is stated twice as vague
READ = (1.0, 1.0, 0.99, 0.99, 0.88, 0.85, 0.74, 0.72)
STATED_SPREAD = 0.35  # of the stated deviations' logarithm
AMBIGUOUS_STEPS = (  # up to a distance, up to an incidence (degrees): how often
    (2.0, 90, 0.0),
    (2.5, 20, 0.02),
    (3.0, 20, 0.47),
    (3.0, 35, 0.09),
    (4.0, 20, 1.0),
    (4.0, 35, 0.05),
    (5.0, 35, 0.9),
    (5.0, 90, 0.12),
    (7.0, 35, 1.0),
    (7.0, 90, 0.08),
)
LUCK_FADES_S = 0.4  # what makes a look ambiguous, vague or unread lasts as long
RANGE_BIAS, RANGE_COMMON, RANGE_SAME, RANGE_FADES_S, RANGE_NEW = 0.0055, 0.003, 0.006, 4.0, 0.0018  # shares
HEADING_SAME, HEADING_FADES_S, HEADING_NEW = math.radians(0.36), 1.2, math.radians(0.24)
FULL_FROM_M = 3.0  # nearer, shares and headings err less, in proportion
ACROSS_SAME, ACROSS_FADES_S, ACROSS_NEW = 0.00009, 0.8, 0.00005  # of the distance


@dataclass(slots=True)
class Process:
    """A standard normal Gauss-Markov process, drawn when it is asked for."""

    value: float = 0.0
    t_s: float = -math.inf

    def at(self, t_s: float, fades_s: float, rng: np.random.Generator) -> float:
        keeps = math.exp(-(t_s - self.t_s) / fades_s)
        self.value = keeps * self.value + math.sqrt(1 - keeps**2) * rng.standard_normal()
        self.t_s = t_s
        return self.value


@dataclass(slots=True)
class PanelErrors:
    """A panel's errors, and its luck."""

    range: Process = field(default_factory=Process)
    heading: Process = field(default_factory=Process)
    across: Process = field(default_factory=Process)
    read: Process = field(default_factory=Process)
    ambiguous: Process = field(default_factory=Process)
    stated: Process = field(default_factory=Process)


class Looks:
    """Looks at panels that hang at `hung` (x, y, yaw), of which the map says `mapped`."""

    def __init__(
        self,
        rng: np.random.Generator,
        hung: dict[int, Floats],
        mapped: dict[int, Floats],
        hidden: float,
        height_m: float = HEIGHT_M,
    ) -> None:
        self._rng, self._hidden, self._height_m = rng, hidden, height_m
        self._hung = {panel: place(*at, height_m) for panel, at in hung.items()}
        self._headings = {panel: (hung[panel][2], mapped[panel][2]) for panel in hung}
        self._common = rng.normal(RANGE_BIAS, RANGE_COMMON)
        self._errors = {panel: PanelErrors() for panel in hung}

    def frame(self, t_s: float, pose: Floats) -> list[Look]:
        """The looks of a frame that was exposed at `t_s` from `pose` (x, y, yaw)."""
        if self._rng.random() < self._hidden:
            return []
        turn = matrix_from_rpy_deg(0, 0, math.degrees(pose[2]))
        base_from_map = inverse(transform(turn, np.array([pose[0], pose[1], 0.0])))
        looks = [self._look(t_s, pose[2], panel, base_from_map @ at) for panel, at in self._hung.items()]
        return [look for look in looks if look is not None]

    def _look(self, t_s: float, yaw: float, panel: int, base_from_marker: Floats) -> Look | None:
        if not is_in_view(base_from_marker):
            return None
        rng, errors = self._rng, self._errors[panel]
        ray = base_from_marker[:3, 3] - BASE_FROM_CAMERA[:3, 3]
        distance = float(np.linalg.norm(ray))
        normal = base_from_marker[:3, 2]
        incidence = math.degrees(math.acos(min(1.0, -normal @ ray / distance)))
        if _chance(errors.read.at(t_s, LUCK_FADES_S, rng)) > np.interp(distance, DISTANCES, READ):
            return None
        flat = ray[:2] / np.hypot(*ray[:2])
        aside = np.array([-flat[1], flat[0]])
        share = self._common + RANGE_SAME * errors.range.at(t_s, RANGE_FADES_S, rng) + rng.normal(0, RANGE_NEW)
        sideways = ACROSS_SAME * errors.across.at(t_s, ACROSS_FADES_S, rng) + rng.normal(0, ACROSS_NEW)
        nearness = min(1.0, distance / FULL_FROM_M)
        centre = base_from_marker[:2, 3] + ray[:2] * share * nearness + aside * sideways * distance
        turned = HEADING_SAME * errors.heading.at(t_s, HEADING_FADES_S, rng) + rng.normal(0, HEADING_NEW)
        hung, mapped = self._headings[panel]
        heading = wrapped(yaw + mapped - hung + turned * nearness)
        # Turned about the line of sight into its mirror: the panel's yaw in base_link is 2·sight − its own.
        mirror = wrapped(2 * (mapped - math.atan2(-flat[1], -flat[0])) - heading)
        factor = math.exp(STATED_SPREAD * errors.stated.at(t_s, LUCK_FADES_S, rng))
        stated = _stated(distance, incidence, flat) * factor**2
        ambiguous = _chance(errors.ambiguous.at(t_s, LUCK_FADES_S, rng)) < _ambiguity(distance, incidence)
        wrong_first = incidence < 10 and rng.random() < (0.35 if distance > 5 else 0.02)
        headings = [mirror, heading] if ambiguous and wrong_first else [heading, mirror]
        return self._as_look(t_s, panel, centre, headings[: 2 if ambiguous else 1], stated)

    def _as_look(self, t_s: float, panel: int, centre: Floats, headings: list[float], stated: Floats) -> Look:
        """The record, from the one or two headings that are possible."""
        camera = BASE_FROM_CAMERA[:2, 3]
        split = [split_noise(np.array([*centre, h]), stated, camera, self._height_m) for h in headings]
        (pose, share, turned), other = split[0], split[1][0] if len(split) > 1 else None
        return Look(
            t_ns=round(t_s * 1e9),
            panel=panel,
            pose=pose,
            alternate=other,
            range_share=share,
            heading_rad=turned,
            above_m=self._height_m - BASE_FROM_CAMERA[2, 3],
        )


def turned_about_camera(pose: Floats, mount_rad: float) -> Floats:
    """Returns where base_link (x, y, yaw) would be if the camera, which looks so far to the left, sat as believed."""
    x, y, yaw = pose.tolist()
    (ahead, left), turned = BASE_FROM_CAMERA[:2, 3], yaw + mount_rad
    x += ahead * (math.cos(yaw) - math.cos(turned)) - left * (math.sin(yaw) - math.sin(turned))
    y += ahead * (math.sin(yaw) - math.sin(turned)) + left * (math.cos(yaw) - math.cos(turned))
    return np.array([x, y, turned])


def _stated(distance: float, incidence: float, ray: Floats) -> Floats:
    """The covariance that the decoder says of x, y and heading."""
    along, across = np.interp(distance, DISTANCES, ALONG_M), np.interp(distance, DISTANCES, ACROSS_M)
    heading = math.radians(np.interp(distance, DISTANCES, HEADING_DEG)) * (2 if incidence < FRONTAL_TWICE_DEG else 1)
    covariance = np.zeros((3, 3))
    axes = np.array([[ray[0], -ray[1]], [ray[1], ray[0]]])
    covariance[:2, :2] = axes @ np.diag([along**2, across**2]) @ axes.T
    covariance[2, 2] = heading**2
    return covariance


def _ambiguity(distance: float, incidence: float) -> float:
    """The share of such looks that are ambiguous."""
    return next((p for far, wide, p in AMBIGUOUS_STEPS if distance <= far and incidence <= wide), 0.0)


def _chance(standard: float) -> float:
    """Uniform, of a standard normal number."""
    return 0.5 * math.erfc(-standard / math.sqrt(2))
