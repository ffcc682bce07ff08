"""Every key of a configuration with its value, and where that comes from."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from ledpi.config.mistakes import SECRET
from ledpi.config.settings import Config

DEFAULT, COMMAND_LINE = "default", "--set"


def values_of(config: Config) -> dict[str, Any]:
    """By dotted key, as JSON has them. A secret is only said to be there."""
    return {key: _shown(key, value) for key, value, _ in _leaves(config)}


def origins_of(config: Config) -> dict[str, str]:
    """By dotted key: `default`, `--set`, or the file's path."""
    file = DEFAULT if config.file is None else str(config.file)
    return {key: _origin(key, file if given else DEFAULT, config) for key, _, given in _leaves(config)}


def _origin(key: str, else_: str, config: Config) -> str:
    is_set = any(one == key or one.startswith(f"{key}.") for one in config.from_command_line)
    return COMMAND_LINE if is_set else else_


def _leaves(section: BaseModel, prefix: str = "", given: bool = True) -> Iterator[tuple[str, Any, bool]]:
    """Key, value, and whether it was given."""
    plain = section.model_dump(mode="json")
    for name in type(section).model_fields:
        value, is_given = getattr(section, name), given and name in section.model_fields_set
        if isinstance(value, BaseModel):
            yield from _leaves(value, f"{prefix}{name}.", is_given)
        else:
            yield prefix + name, plain[name], is_given


def _shown(key: str, value: Any) -> Any:
    return "(not shown)" if key.endswith(SECRET) and value is not None else value
