"""`--set KEY=VALUE`: one value of the configuration, given on the command line; and names of an earlier version."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from ledpi.core.errors import ConfigError, one_line, shortened, shortened_name
from ledpi.core.files import parse_yaml

Key = tuple[str | int, ...]  # ("panels", "overrides", 7, "black_hz")
# Decoding methods that are still read, with a note on standard error.
METHODS = {"soft": "likelihood", "bands": "uemura"}


def overrides_of(set_: Sequence[str], options: Mapping[str, object]) -> tuple[str, ...]:
    """Those of --set, then a command's own options by the keys that they override; None was not given."""
    return (*set_, *(f"{key}={value}" for key, value in options.items() if value is not None))


def parse_override(item: str) -> tuple[Key, Any]:
    """Splits KEY=VALUE, and reads the value as YAML. Raises ConfigError."""
    key, equals, text = item.partition("=")
    if not equals or not key or not key.isprintable():
        raise ConfigError(f"--set {item}: must be KEY=VALUE, as in --set camera.source=simulated")
    try:
        value = parse_yaml(text, "", ConfigError)
    except ConfigError:
        raise ConfigError(f"--set {shortened_name(item)}: {shortened(text)} is not a YAML value") from None
    if isinstance(value, (dict, list)) and not text.lstrip().startswith(("{", "[")):
        value = text  # `recording:` and `-` are words here, although YAML reads a mapping and a list
    # A key of digits is a panel's ID, and YAML reads that as a number; one so long that Python refuses it is none.
    return tuple(int(part) if part.isdecimal() and len(part) < 20 else part for part in key.split(".")), value


def apply_override(raw: dict[str, Any], item: str) -> set[str]:
    """Puts a value in its place. Returns the keys that it gives: those of a whole section. Raises ConfigError."""
    key, value = parse_override(item)
    *sections, last = key
    node: Any = raw
    for name in sections:
        if node.get(name) is None:
            node[name] = {}
        node = node[name]
        if not isinstance(node, dict):
            raise ConfigError(f"--set {item}: {name} is a value, not a section")
    node[last] = value
    return _keys_of(".".join(map(str, key)), value)


def _keys_of(key: str, value: object) -> set[str]:
    if not isinstance(value, dict):
        return {key}
    return {inner for name, part in value.items() for inner in _keys_of(f"{key}.{name}", part)}


def current_name(name: str, renamed: dict[str, str], where: str) -> str:
    """Returns what `name` is called today. `where` names the key or option, as in `config.yaml: decode.method`."""
    if name not in renamed:
        return name
    print(f"ledpi: {one_line(where)}: {name} is now called {renamed[name]}", file=sys.stderr)
    return renamed[name]


def rename_method(raw: dict[str, Any], where: str) -> None:
    """Puts today's name of the method into a configuration that has an old one."""
    section = raw.get("decode")
    if isinstance(section, dict) and isinstance(section.get("method"), str):
        section["method"] = current_name(section["method"], METHODS, f"{where}: decode.method")
