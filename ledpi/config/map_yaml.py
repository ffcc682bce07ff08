"""markers.yaml: where each panel hangs in the map, as a person measures it or `ledpi calibrate map` writes it.

docs/map.md is the format's description.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import AfterValidator, ConfigDict, model_validator

from ledpi.config.mistakes import validated
from ledpi.config.values import (
    Degrees,
    DeviationDeg,
    DeviationM,
    Finite,
    MapPosition,
    MarkerId,
    NoBooleans,
    SideM,
    unit_quaternion,
)
from ledpi.core.errors import ConfigError
from ledpi.core.files import read_yaml
from ledpi.core.geometry import (
    FACING_FROM_MARKER,
    matrix_from_quaternion,
    matrix_from_rpy_deg,
    quaternion_from_matrix,
    transform,
)
from ledpi.core.records import Floats, read_only
from ledpi.pose.panel_map import MapPanel, PanelMap

# Where a map does not say how well its panels are placed: a tape measure on a wall, a panel hung by eye.
BY_TAPE_M, BY_EYE_DEG = 0.01, 1.0


class _Part(NoBooleans):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Deviations(_Part):
    position_m: DeviationM = BY_TAPE_M
    angle_deg: DeviationDeg = BY_EYE_DEG


class _Panel(_Part):
    position_m: MapPosition
    quaternion_wxyz: Annotated[list[Finite], AfterValidator(unit_quaternion)] | None = None
    yaw_deg: Degrees | None = None
    pitch_deg: Degrees | None = None
    roll_deg: Degrees | None = None
    side_m: SideM | None = None
    deviations: _Deviations | None = None

    @model_validator(mode="after")
    def _turned_once(self) -> _Panel:
        angles = (self.yaw_deg, self.pitch_deg, self.roll_deg)
        if (self.quaternion_wxyz is None) == all(angle is None for angle in angles):
            wanted = "either quaternion_wxyz, or where it faces: yaw_deg, pitch_deg, roll_deg, one of them at least"
            raise ValueError(f"must have {wanted}")
        return self

    def map_from_marker(self) -> Floats:
        if self.quaternion_wxyz is not None:
            rotation = matrix_from_quaternion(np.array(self.quaternion_wxyz))
        else:
            turned = matrix_from_rpy_deg(self.roll_deg or 0.0, self.pitch_deg or 0.0, self.yaw_deg or 0.0)
            rotation = turned @ FACING_FROM_MARKER
        return transform(rotation, np.array(self.position_m))


def _check_not_empty(panels: dict[int, _Panel]) -> dict[int, _Panel]:
    if panels:
        return panels
    raise ValueError("must hold a panel at least")


class _Map(_Part):
    format: Literal[1] = 1
    deviations: _Deviations = _Deviations()
    panels: Annotated[dict[MarkerId, _Panel], AfterValidator(_check_not_empty)]


def load_map(path: Path) -> PanelMap:
    """Reads markers.yaml. Raises ConfigError with file and key."""
    raw = read_yaml(path, ConfigError)
    if not isinstance(raw, dict):
        raise ConfigError(f"{path}: must be a map of panels (format: 1, panels: …)")
    content = validated(_Map, raw, str(path), ConfigError)
    panels = {}
    for marker_id, panel in content.panels.items():
        known = panel.deviations or content.deviations
        panels[marker_id] = MapPanel(
            map_from_marker=read_only(panel.map_from_marker()),
            side_m=panel.side_m,
            position_sigma_m=known.position_m,
            angle_sigma_rad=math.radians(known.angle_deg),
        )
    return panels


def map_text(panels: PanelMap, comment: str) -> str:
    """The text of a markers.yaml, `comment` (lines) at its head."""
    content: dict[int, dict[str, Any]] = {}
    for marker_id, panel in sorted(panels.items()):
        place = panel.map_from_marker
        values: dict[str, Any] = {
            "position_m": [round(float(v), 5) for v in place[:3, 3]],
            "quaternion_wxyz": [round(float(v), 7) for v in quaternion_from_matrix(place[:3, :3])],
        }
        if panel.side_m is not None:
            values["side_m"] = float(panel.side_m)
        values["deviations"] = {
            "position_m": round(panel.position_sigma_m, 5),
            "angle_deg": round(math.degrees(panel.angle_sigma_rad), 4),
        }
        content[marker_id] = values
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    body = yaml.safe_dump({"format": 1, "panels": content}, sort_keys=False, default_flow_style=None, width=140)
    return head + body
