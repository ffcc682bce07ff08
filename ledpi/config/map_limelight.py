"""Limelight's field map (`.fmap`, JSON) → a map of panels.

Its fiducials are `{"id", "size", "transform"}`: the size in millimetres, the transform field_from_tag row by row in
metres (Limelight's documentation, "AprilTag map specification"). A tag's own x comes out of it, its z points up. The
origin is the field's centre, where WPILib's is a corner.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from ledpi.config.map_yaml import BY_EYE_DEG, BY_TAPE_M
from ledpi.config.mistakes import validated
from ledpi.config.values import MAX_SIDE_M, Finite, MarkerId, NoBooleans, PlaceM
from ledpi.core.errors import ConfigError
from ledpi.core.geometry import FACING_FROM_MARKER, transform
from ledpi.core.records import read_only
from ledpi.pose.panel_map import MapPanel, PanelMap

ROUNDED = 0.01  # by which a rotation's lengths and angles may be off: a program has rounded it


def _rigid(values: list[float]) -> list[float]:
    if len(values) != 16:
        raise ValueError("must be 16 numbers, a 4 × 4 matrix row by row")
    matrix = np.array(values).reshape(4, 4)
    turn = matrix[:3, :3]
    off = max(np.abs(turn @ turn.T - np.eye(3)).max(), np.abs(matrix[3] - (0, 0, 0, 1)).max())
    if not off < ROUNDED or np.linalg.det(turn) < 0:
        raise ValueError("must be a rotation and a place: [r, r, r, x, r, r, r, y, r, r, r, z, 0, 0, 0, 1]")
    return values


class _Fiducial(NoBooleans):
    id: MarkerId
    size: Annotated[float, Field(ge=1, le=1000 * MAX_SIDE_M)]
    transform: Annotated[list[Finite], AfterValidator(_rigid)]


class _FieldMap(NoBooleans):
    fiducials: Annotated[list[_Fiducial], Field(min_length=1)]


class _Place(NoBooleans):
    x: PlaceM
    y: PlaceM
    z: PlaceM


def limelight_panels(raw: dict[str, Any], path: Path) -> PanelMap:
    """The panels of a field map that was read from `path`. Raises ConfigError with file and key."""
    content = validated(_FieldMap, raw, str(path), ConfigError)
    panels: dict[int, MapPanel] = {}
    for index, tag in enumerate(content.fiducials):
        where = f"{path}: fiducials.{index}"
        if tag.id in panels:
            raise ConfigError(f"{where}.id: {tag.id} is there twice; each ID once")
        field_from_tag = np.array(tag.transform).reshape(4, 4)
        place = dict(zip("xyz", field_from_tag[:3, 3].tolist(), strict=True))
        validated(_Place, place, f"{where}.transform", ConfigError)
        left, _, right = np.linalg.svd(field_from_tag[:3, :3])  # the nearest rotation
        panels[tag.id] = MapPanel(
            map_from_marker=read_only(transform(left @ right @ FACING_FROM_MARKER, field_from_tag[:3, 3])),
            side_m=tag.size / 1000.0,
            position_sigma_m=BY_TAPE_M,
            angle_sigma_rad=math.radians(BY_EYE_DEG),
        )
    return panels
