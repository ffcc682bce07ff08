"""The robot's place, as a program uses it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from ledpi.core.geometry import matrix_from_quaternion
from ledpi.core.records import Floats, RobotFix


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fix:
    """The robot's pose in the map, map_from_base_link: x ahead, y left, z up. The arrays are read-only."""

    position_m: Floats  # (3,)
    quaternion_wxyz: Floats  # (4,) unit length
    covariance: Floats | None  # (6, 6): x y z (m²), rotation about the map's x y z (rad²)
    panels_used: tuple[int, ...]
    panels_rejected: tuple[int, ...]  # those that contradict the others
    time_ns: int  # on the clock of the time that came with the picture

    @property
    def heading(self) -> float:
        """Radians about the map's z axis: 0 looks along x, positive turns towards y."""
        turned = matrix_from_quaternion(self.quaternion_wxyz)
        return math.atan2(turned[1, 0], turned[0, 0])

    def to_dict(self) -> dict[str, Any]:
        """Numbers, lists and None only, as JSON has them."""
        return {
            "position_m": self.position_m.tolist(),
            "quaternion_wxyz": self.quaternion_wxyz.tolist(),
            "covariance": None if self.covariance is None else self.covariance.tolist(),
            "heading": self.heading,
            "panels_used": list(self.panels_used),
            "panels_rejected": list(self.panels_rejected),
            "time_ns": self.time_ns,
        }


def fix_of(decoded: RobotFix | None) -> Fix | None:
    """The decoder's record, as a program uses it."""
    if decoded is None:
        return None
    pose = decoded.map_from_base_link
    return Fix(
        position_m=pose.position_m,
        quaternion_wxyz=pose.quaternion_wxyz,
        covariance=pose.covariance,
        panels_used=decoded.panels_used,
        panels_rejected=decoded.panels_rejected,
        time_ns=decoded.mid_exposure_ns,
    )
