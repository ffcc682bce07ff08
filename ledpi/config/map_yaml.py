"""markers.yaml: where each panel hangs in the map, as a person measures it or `ledpi calibrate map` writes it.

docs/map.md is the format's description. WPILib's field layout is read and written, Limelight's field map is read.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import AfterValidator, ConfigDict, Field, model_validator

from ledpi.config.mistakes import validated
from ledpi.config.values import (
    MAX_PLACE_M,
    MAX_SIDE_M,
    Degrees,
    DeviationDeg,
    DeviationM,
    Finite,
    MapPosition,
    MarkerId,
    NoBooleans,
    PlaceM,
    SideM,
    unit_quaternion,
)
from ledpi.core.errors import ConfigError
from ledpi.core.files import parse_json, read_text, read_yaml
from ledpi.core.geometry import (
    FACING_FROM_MARKER,
    matrix_from_quaternion,
    matrix_from_rpy_deg,
    quaternion_from_matrix,
    transform,
)
from ledpi.core.records import Floats, MapPanel, PanelMap, read_only

ROUNDED = 0.01  # by which a rotation's lengths and angles may be off: a program has rounded it
LEAST_MM, MOST_MM = 20.0, 1000 * MAX_SIDE_M  # smaller ones are no panels, but sizes in inches or metres
# Where a map does not say how well its panels are placed: a tape measure on a wall, a panel hung by eye.
BY_TAPE_M, BY_EYE_DEG = 0.01, 1.0


def _rigid(values: list[float]) -> list[float]:
    if len(values) != 16:
        raise ValueError("must be 16 numbers, a 4 × 4 matrix row by row")
    matrix = np.array(values).reshape(4, 4)
    turn = np.clip(matrix[:3, :3], -2, 2)
    off = max(np.abs(turn @ turn.T - np.eye(3)).max(), np.abs(matrix[3] - (0, 0, 0, 1)).max())
    if not off < ROUNDED or np.linalg.det(turn) < 0:
        raise ValueError("must be a rotation and a place: [r, r, r, x, r, r, r, y, r, r, r, z, 0, 0, 0, 1]")
    if np.abs(matrix[:3, 3]).max() > MAX_PLACE_M:
        raise ValueError(f"must have x, y and z in metres, within {MAX_PLACE_M:g}")
    return values


def _in_millimetres(size: float) -> float:
    if not LEAST_MM <= size <= MOST_MM:
        raise ValueError(f"must be {LEAST_MM:g} to {MOST_MM:g} millimetres")
    return size


class _Fiducial(NoBooleans):
    id: MarkerId
    size: Annotated[Finite, AfterValidator(_in_millimetres)]
    transform: Annotated[list[Finite], AfterValidator(_rigid)]


class _FieldMap(NoBooleans):
    fiducials: Annotated[list[_Fiducial], Field(min_length=1)]


def limelight_panels(raw: dict[str, Any], path: Path) -> PanelMap:
    """The panels of a field map that was read from `path`. Raises ConfigError with file and key."""
    content = validated(_FieldMap, raw, str(path), ConfigError)
    panels: dict[int, MapPanel] = {}
    for index, tag in enumerate(content.fiducials):
        if tag.id in panels:
            raise ConfigError(f"{path}: fiducials.{index}.id: {tag.id} is there twice; each ID once")
        field_from_tag = np.array(tag.transform).reshape(4, 4)
        left, _, right = np.linalg.svd(field_from_tag[:3, :3])  # the nearest rotation
        panels[tag.id] = MapPanel(
            map_from_marker=read_only(transform(left @ right @ FACING_FROM_MARKER, field_from_tag[:3, 3])),
            side_m=tag.size / 1000.0,
            position_sigma_m=BY_TAPE_M,
            angle_sigma_rad=math.radians(BY_EYE_DEG),
        )
    return panels


class _Translation(NoBooleans):
    x: PlaceM
    y: PlaceM
    z: PlaceM


class _Quaternion(NoBooleans):
    W: Finite
    X: Finite
    Y: Finite
    Z: Finite


class _Rotation(NoBooleans):
    quaternion: _Quaternion


class _Pose(NoBooleans):
    translation: _Translation
    rotation: _Rotation


class _Tag(NoBooleans):
    ID: MarkerId
    pose: _Pose


class _Field(NoBooleans):
    length: Annotated[PlaceM, Field(gt=0)]
    width: Annotated[PlaceM, Field(gt=0)]


class _Layout(NoBooleans):
    tags: Annotated[list[_Tag], Field(min_length=1)]
    field: _Field | None = None


class _Layout2027(NoBooleans):
    tags: Annotated[list[_Tag], Field(min_length=1, alias="field-tags")]
    field: _Field | None = Field(None, alias="field-dimensions")


def load_layout(path: Path) -> PanelMap:
    """Reads a field layout, or Limelight's `.fmap`. Raises ConfigError with file and key."""
    try:
        raw = parse_json(read_text(path, ConfigError))
    except ValueError as error:
        raise ConfigError(f"{path}: not valid JSON: {error}") from None
    if not isinstance(raw, dict):
        raise ConfigError(f"{path}: must be a field layout, an object with `tags`")
    lists = [name for name in ("tags", "field-tags", "fiducials") if name in raw]
    if len(lists) > 1:
        raise ConfigError(f"{path}: {' and '.join(lists)}: must be one of them, not {len(lists)}")
    if "fiducials" in raw:
        return limelight_panels(raw, path)
    name = "field-tags" if "field-tags" in raw else "tags"
    model: type[_Layout | _Layout2027] = _Layout2027 if name == "field-tags" else _Layout
    layout = validated(model, raw, str(path), ConfigError)
    panels: dict[int, MapPanel] = {}
    for index, tag in enumerate(layout.tags):
        if tag.ID in panels:
            raise ConfigError(f"{path}: {name}.{index}.ID: {tag.ID} is there twice; each ID once")
        q, t = tag.pose.rotation.quaternion, tag.pose.translation
        quaternion = np.array([q.W, q.X, q.Y, q.Z])
        length = math.hypot(q.W, q.X, q.Y, q.Z)
        if abs(length - 1) > 0.01:
            raise ConfigError(f"{path}: {name}.{index}.pose.rotation.quaternion: must have length 1, not {length:.3g}")
        place = transform(matrix_from_quaternion(quaternion) @ FACING_FROM_MARKER, np.array([t.x, t.y, t.z]))
        panels[tag.ID] = MapPanel(
            map_from_marker=read_only(place),
            position_sigma_m=BY_TAPE_M,
            angle_sigma_rad=math.radians(BY_EYE_DEG),
        )
    return panels


def layout_text(panels: PanelMap, field_m: tuple[float, float]) -> str:
    """The JSON of a field layout; `field_m` is the field's length and width, which WPILib wants. Sizes are lost."""
    tags: list[dict[str, Any]] = []
    for marker_id, panel in sorted(panels.items()):
        x, y, z = (float(v) for v in panel.map_from_marker[:3, 3])
        w, qx, qy, qz = (float(v) for v in quaternion_from_matrix(panel.map_from_marker[:3, :3] @ FACING_FROM_MARKER.T))
        rotation = {"quaternion": {"W": w, "X": qx, "Y": qy, "Z": qz}}
        tags.append({"ID": marker_id, "pose": {"translation": {"x": x, "y": y, "z": z}, "rotation": rotation}})
    return json.dumps({"tags": tags, "field": {"length": field_m[0], "width": field_m[1]}}, indent=2) + "\n"


class _Part(NoBooleans):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Deviations(_Part):
    """Standard deviations of a panel's place, on each axis."""

    position_m: DeviationM = BY_TAPE_M
    angle_deg: DeviationDeg = BY_EYE_DEG


class PanelPlace(_Part):
    """A panel's place in a map, or on a body, as a person writes it."""

    position_m: MapPosition
    quaternion_wxyz: Annotated[list[Finite], AfterValidator(unit_quaternion)] | None = None
    yaw_deg: Degrees | None = None
    pitch_deg: Degrees | None = None
    roll_deg: Degrees | None = None
    deviations: Deviations | None = None

    @model_validator(mode="after")
    def _turned_once(self) -> PanelPlace:
        angles = (self.yaw_deg, self.pitch_deg, self.roll_deg)
        if (self.quaternion_wxyz is None) == all(angle is None for angle in angles):
            wanted = "either quaternion_wxyz, or where it faces: yaw_deg, pitch_deg, roll_deg, one of them at least"
            raise ValueError(f"must have {wanted}")
        return self

    def map_from_marker(self) -> Floats:
        """(4, 4)."""
        if self.quaternion_wxyz is not None:
            rotation = matrix_from_quaternion(np.array(self.quaternion_wxyz))
        else:
            turned = matrix_from_rpy_deg(self.roll_deg or 0.0, self.pitch_deg or 0.0, self.yaw_deg or 0.0)
            rotation = turned @ FACING_FROM_MARKER
        return transform(rotation, np.array(self.position_m))

    def map_panel(self, usual: Deviations, side_m: float | None = None) -> MapPanel:
        """The same for the solver. `usual`: deviations, where the panel has none of its own."""
        known = self.deviations or usual
        return MapPanel(
            map_from_marker=read_only(self.map_from_marker()),
            side_m=side_m,
            position_sigma_m=known.position_m,
            angle_sigma_rad=math.radians(known.angle_deg),
        )


class _Panel(PanelPlace):
    side_m: SideM | None = None


def _check_not_empty(panels: dict[int, _Panel]) -> dict[int, _Panel]:
    if panels:
        return panels
    raise ValueError("must hold a panel at least")


class _Map(_Part):
    format: Literal[1] = 1
    deviations: Deviations = Deviations()
    panels: Annotated[dict[MarkerId, _Panel], AfterValidator(_check_not_empty)]


def load_map(path: Path) -> PanelMap:
    """Reads markers.yaml. Raises ConfigError with file and key."""
    raw = read_yaml(path, ConfigError)
    if not isinstance(raw, dict):
        raise ConfigError(f"{path}: must be a map of panels (format: 1, panels: …)")
    content = validated(_Map, raw, str(path), ConfigError)
    return {i: panel.map_panel(content.deviations, panel.side_m) for i, panel in content.panels.items()}


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
