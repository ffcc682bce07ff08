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
from ledpi.config.values import MAX_PLACE_M, MAX_SIDE_M, Finite, MarkerId, NoBooleans
from ledpi.core.errors import ConfigError
from ledpi.core.geometry import FACING_FROM_MARKER, transform
from ledpi.core.records import read_only
from ledpi.pose.panel_map import MapPanel, PanelMap

ROUNDED = 0.01  # by which a rotation's lengths and angles may be off: a program has rounded it
LEAST_MM, MOST_MM = 20.0, 1000 * MAX_SIDE_M  # smaller ones are no panels, but sizes in inches or metres


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
