"""WPILib's AprilTag field layout (JSON) ↔ a map of panels; and Limelight's field map, which only comes in.

The layout's tags are `{"ID", "pose": {"translation": {x, y, z}, "rotation": {"quaternion": {W, X, Y, Z}}}}` in metres;
a tag's own x comes out of it, its z points up (WPILib's documentation, "AprilTags: coordinate system"). Since 2027 they
are called `field-tags`.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from ledpi.config.map_limelight import limelight_panels
from ledpi.config.map_yaml import BY_EYE_DEG, BY_TAPE_M
from ledpi.config.mistakes import validated
from ledpi.config.values import Finite, MarkerId, NoBooleans, PlaceM
from ledpi.core.errors import ConfigError
from ledpi.core.files import parse_json, read_text
from ledpi.core.geometry import FACING_FROM_MARKER, matrix_from_quaternion, quaternion_from_matrix, transform
from ledpi.core.records import read_only
from ledpi.pose.panel_map import MapPanel, PanelMap


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
