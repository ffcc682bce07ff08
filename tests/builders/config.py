"""Keys of the configuration, for its tests and its page's: those that there are, and those that a file writes."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel


def known_keys(model: type[BaseModel], prefix: str = "") -> set[str]:
    """Every dotted key of a model. A free mapping (panels.overrides) is one key."""
    keys: set[str] = set()
    for name, field in model.model_fields.items():
        annotation = field.annotation
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            keys |= known_keys(annotation, f"{prefix}{name}.")
        else:
            keys.add(prefix + name)
    return keys


def written_values(node: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Every dotted key of a file, with its value."""
    values: dict[str, Any] = {}
    for name, value in node.items():
        is_section = isinstance(value, dict) and value
        values |= written_values(value, f"{prefix}{name}.") if is_section else {prefix + name: value}
    return values
