"""The robot's state, as a program uses it."""

from __future__ import annotations

import operator
from dataclasses import dataclass
from typing import Any

from ledpi.config.settings import Config
from ledpi.core.errors import PictureError
from ledpi.core.records import Floats, MarkerPose, Rejected
from ledpi.core.wording import shortened
from ledpi.pipeline.api.lens import plain
from ledpi.pipeline.pipeline import load_robot
from ledpi.state import estimator
from ledpi.state.inputs import Odometry


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class State:
    """The robot's pose in the map's plane at a time, map_from_base_link. The arrays are read-only."""

    position_m: Floats  # (2,) x, y
    heading: float  # radians about the map's z axis: 0 looks along x, positive turns towards y
    covariance: Floats  # (3, 3): x, y, heading; spans both while another pose is possible
    speed_m_s: float  # ahead
    turn_rad_s: float  # to the left
    time_ns: int  # on the clock of the times that came with pictures and odometry
    panel_time_ns: int  # when the newest panel that was used was exposed
    way_m: float  # driven since
    by_odometry: bool  # else none was told of late, and it goes on as it moved
    contested: bool  # another pose is possible
    moved: tuple[int, ...]  # panels that hang elsewhere than the map says
    relocalisations: int  # how often it turned out to be elsewhere

    def to_dict(self) -> dict[str, Any]:
        """Numbers, lists and None only, as JSON has them."""
        return plain(self)


class Whereabouts:
    """The estimator of one stream's robot."""

    def __init__(self, config: Config) -> None:
        robot = load_robot(config)
        self._estimator = estimator.Estimator(robot.panels or {}, robot.base_link_from_camera, config.odometry.noise)

    def add_markers(self, markers: tuple[MarkerPose, ...]) -> None:
        """Takes those of a picture."""
        self._estimator.add_markers(markers, max((marker.mid_exposure_ns for marker in markers), default=0))

    def add_odometry(self, time_ns: int, totals: dict[str, float | None], flags: dict[str, bool]) -> str | None:
        """Returns why it tells nothing. Raises PictureError for what is no number."""
        t_ns = whole_ns(time_ns)
        for name, value in totals.items():
            if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
                raise PictureError(f"{name}: must be a number or None, not {shortened(value)}")
        if (totals["left_m"] is None) != (totals["right_m"] is None):
            raise PictureError("left_m, right_m: must be two numbers, or None both")
        odometry = Odometry(
            t_ns=t_ns,
            left_m=totals["left_m"],
            right_m=totals["right_m"],
            yaw_rad=totals["yaw_rad"],
            restarted=flags["restarted"],
            lifted=flags["lifted"],
            slipping=flags["slipping"],
        )
        rejected = self._estimator.add_odometry(odometry, t_ns)
        return None if rejected is None else rejected.key

    def at(self, time_ns: int) -> State | None:
        """None where it is not known."""
        found = self._estimator.at(whole_ns(time_ns))
        if isinstance(found, Rejected):
            return None
        return State(
            position_m=found.pose[:2],
            heading=float(found.pose[2]),
            covariance=found.covariance,
            speed_m_s=found.speed_m_s,
            turn_rad_s=found.turn_rad_s,
            time_ns=found.t_ns,
            panel_time_ns=found.panel_ns,
            way_m=found.way_m,
            by_odometry=found.by_odometry,
            contested=found.contested,
            moved=found.moved,
            relocalisations=found.relocalisations,
        )


def whole_ns(time_ns: int) -> int:
    """Raises PictureError for what is no whole number."""
    try:
        return operator.index(time_ns)
    except TypeError:
        raise PictureError(f"time_ns: must be whole nanoseconds, not {shortened(time_ns)}") from None
