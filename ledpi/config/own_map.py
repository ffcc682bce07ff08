"""The configuration's own map, and what in it contradicts the configuration."""

from __future__ import annotations

from pathlib import Path

from ledpi.config.map_yaml import load_map
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import Config
from ledpi.core.errors import ConfigError
from ledpi.core.records import PanelMap

MAX_NAMED = 5  # that are named of many


def load_own_map(config: Config) -> PanelMap | None:
    """The map, if there is one. Raises ConfigError, also where it and the configuration contradict each other."""
    if config.map is None:
        return None
    panels = load_map(config.map)
    for marker_id, override in config.panels.overrides.items():
        side_m = panels[marker_id].side_m if marker_id in panels else None
        if side_m is not None and override.side_m is not None and side_m != override.side_m:
            raise ConfigError(
                f"{config.map}: panels.{marker_id}.side_m: is {side_m}, but panels.overrides.{marker_id}.side_m in "
                f"the configuration is {override.side_m}: give it once"
            )
    for name, places in config.bodies.items():
        for marker_id in places.keys() & panels.keys():
            raise ConfigError(
                f"{config.map}: panels.{marker_id}: is also in the configuration, as bodies.{name}.{marker_id}; a "
                "body's panel has no place in the room: take it out of one"
            )
    return panels


def unreadable_note(settings: PanelSettings, panels: PanelMap | None, file: Path | None) -> str:
    """Names the map's panels that are never reported: without a word, or no panels by `panels.ids`; "" if none are.

    That is no error: a field's layout may hold tags that others read.
    """
    words = len(settings.words.codewords)
    unreadable = sorted(marker_id for marker_id in panels or {} if marker_id >= words)
    notes = []
    if unreadable:
        named = ", ".join(map(str, unreadable[:MAX_NAMED])) + (", …" if len(unreadable) > MAX_NAMED else "")
        notes.append(f"{named} in {file} cannot be read: {settings.dictionary} has IDs 0 to {words - 1}")
    if note := settings.unreported_note(panels or {}):
        notes.append(f"{file}: {note}")
    return "; ".join(notes)
