"""The section `bodies`: things that carry panels (a dock, a cart, another robot), each a map of its own."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from ledpi.config.map_yaml import Deviations, PanelPlace
from ledpi.config.outputs import OutputName
from ledpi.config.panels import PanelSettings
from ledpi.config.values import MarkerId
from ledpi.core.errors import ConfigError
from ledpi.core.records import PanelMap

BY_RULER = Deviations(position_m=0.002, angle_deg=0.5)  # on one rigid thing, where a map's are taped along walls
Bodies = dict[OutputName, dict[MarkerId, PanelPlace]]


def check_bodies(bodies: Bodies, panels: PanelSettings, where: str) -> None:
    """Raises ConfigError for a body without panels, and for panels that cannot be where they are said to be."""
    try:
        known, body_of = len(panels.words.codewords), dict[int, str]()
        sides_m = {i: panels.spec(i).side_m for places in bodies.values() for i in places}
    except ValueError:
        return  # the panels' own check has said why
    for name, places in bodies.items():
        key = f"{where}: bodies.{name}"
        if not places:
            raise ConfigError(f"{key}: must hold a panel at least, as {{7: {{position_m: [0, 0, 0], yaw_deg: 0}}}}")
        for marker_id in places:
            if marker_id >= known:
                raise ConfigError(f"{key}.{marker_id}: {panels.dictionary} has only the IDs 0 to {known - 1}")
            if body_of.setdefault(marker_id, name) != name:
                raise ConfigError(f"{key}.{marker_id}: is on {body_of[marker_id]}, too; must be on one body")
        for one, other in combinations(places, 2):
            if _coincide(places[one], places[other], sides_m[one] + sides_m[other]):
                raise ConfigError(f"{key}.{other}: is where {one} is; each panel must have a place of its own")


def body_maps(bodies: Bodies) -> dict[str, PanelMap]:
    """The maps, by name. x, y and z are the body's own."""
    return {name: {i: place.map_panel(BY_RULER) for i, place in places.items()} for name, places in bodies.items()}


def _coincide(one: PanelPlace, other: PanelPlace, sides_m: float) -> bool:
    """Tells whether two panels that face the same way overlap. Back to back, or around a corner, they do not."""
    a, b = one.map_from_marker(), other.map_from_marker()
    return bool(np.linalg.norm(a[:3, 3] - b[:3, 3]) < sides_m / 4 and a[:3, 2] @ b[:3, 2] > 0)
