"""A map of panels from one drive past them: what was seen together is chained, then adjusted as a whole."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ledpi.core.errors import CalibrationError
from ledpi.core.records import Floats, Intrinsics
from ledpi.pose.panel_map import MapPanel
from ledpi.workshop.calibrate.map_adjust import Adjusted, adjust
from ledpi.workshop.calibrate.map_views import View, camera_poses, chained, informative_views

# What the drive cannot tell of a panel's place: that the panels' sides and the lens are not quite what is configured.
FLOOR_M, FLOOR_RAD = 0.002, math.radians(0.1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapCalibration:
    """A map, and how it came about."""

    panels: dict[int, MapPanel]
    origin: int
    unconnected: tuple[int, ...]  # panels that no frame shows together with one that leads to the origin
    views: int  # frames that were used
    adjusted: Adjusted


def calibrate_map(
    views: Sequence[View],
    map_from_origin: Floats,
    sides_m: Mapping[int, float],
    lens: Intrinsics,
    origin: int | None = None,
    *,
    upright: bool = False,
) -> MapCalibration:
    """The places of all panels that the views connect with the origin panel (the lowest ID, if none is named).

    `map_from_origin` (4, 4) is map_from_marker of that panel; `sides_m` by ID; `upright`: all hang
    upright. Raises CalibrationError.
    """
    telling = informative_views(views)
    together = {panel.id for view in telling for panel in view}
    if not together:
        raise CalibrationError("no frame shows two panels with poses: drive so that neighbours are seen together")
    chosen = min(together) if origin is None else origin
    if chosen not in together:
        seen = ", ".join(map(str, sorted(together)))
        raise CalibrationError(f"--origin {chosen}: no frame shows it together with another; these are: {seen}")
    places = chained(telling, chosen, map_from_origin)
    connected = [tuple(panel for panel in view if panel.id in places) for view in telling]
    used = [view for view in connected if len(view) > 1]
    adjusted = adjust(used, places, camera_poses(used, places, sides_m, lens), chosen, sides_m, lens, upright=upright)
    seen_at_all = {panel.id for view in views for panel in view}
    return MapCalibration(
        panels={i: _panel(place, adjusted.covariances[i], sides_m[i]) for i, place in adjusted.places.items()},
        origin=chosen,
        unconnected=tuple(sorted(seen_at_all - set(places))),
        views=len(used),
        adjusted=adjusted,
    )


def _panel(place: Floats, covariance: Floats, side_m: float) -> MapPanel:
    """With the deviation along an axis and about one, rms over the three."""
    variances = np.diag(covariance)
    return MapPanel(
        map_from_marker=place,
        side_m=side_m,
        position_sigma_m=math.hypot(FLOOR_M, math.sqrt(float(variances[:3].mean()))),
        angle_sigma_rad=math.hypot(FLOOR_RAD, math.sqrt(float(variances[3:].mean()))),
    )
