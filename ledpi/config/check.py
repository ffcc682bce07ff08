"""All that is wrong with a configuration at once, and its own map, with which it must agree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ledpi.config.camera_yaml import load_intrinsics
from ledpi.config.map_yaml import load_map
from ledpi.config.mistakes import explain_all
from ledpi.config.named_files import read_password, tls_context
from ledpi.config.overrides import apply_override, rename_method
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import Config, checks_together, resolve_paths, sections
from ledpi.core.errors import ConfigError, LedpiError, raising
from ledpi.core.files import parse_yaml
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


def mistakes_in(file: Path, overrides: Sequence[str] = (), *, with_files: bool = True) -> list[str]:
    """One line each. `with_files`: looks at the files that it names, too. `overrides`: as of --set."""
    from_command_line: set[str] = set()
    try:
        raw = sections(file)
        for item in overrides:
            from_command_line |= apply_override(raw, item)
    except LedpiError as error:
        return [str(error)]
    found, config = _values(raw, str(file), file.parent, from_command_line)
    return found if config is None or not with_files else found + _files(config)


def mistakes_in_text(text: str, where: str) -> list[str]:
    """As `mistakes_in` without files, of a text that is not yet in a file."""
    try:
        return _values(parse_yaml(text, where, LedpiError), where, Path(), set())[0]
    except LedpiError as error:
        return [str(error)]


def _values(
    raw: dict[str, Any], where: str, base: Path, from_command_line: set[str]
) -> tuple[list[str], Config | None]:
    """Finds what is wrong with keys and values; and the configuration, where each value is right by itself."""
    raw.setdefault("panels", {})
    rename_method(raw, where)
    try:
        config = resolve_paths(Config.model_validate(raw), base, from_command_line)
    except ValidationError as error:
        return [f"{where}: {text}" for text in explain_all(error, Config)], None
    return _said_by(checks_together(config, where)), config


def _files(config: Config) -> list[str]:
    lens, size = config.camera.intrinsics, (config.camera.width, config.camera.height)
    checks: list[Callable[[], object]] = [lambda: load_own_map(config)]
    if lens is not None:
        checks.append(lambda: load_intrinsics(lens, size))
    for name, output in config.outputs.items():
        where = f"outputs.{name}"
        if output.ca_file is not None:
            checks.append(partial(_named_by, f"{where}.ca_file", tls_context, output.ca_file))
        if output.password_file is not None:
            checks.append(partial(_named_by, f"{where}.password_file", read_password, output.password_file))
    return _said_by(checks)


def _named_by(key: str, read: Callable[[Path, type[LedpiError]], object], path: Path) -> None:
    with raising(key, ConfigError, ConfigError):
        read(path, ConfigError)


def _said_by(checks: Sequence[Callable[[], object]]) -> list[str]:
    said = []
    for check in checks:
        try:
            check()
        except (LedpiError, ValueError) as error:
            said.append(str(error))
    return said
