"""Names that earlier versions had for the decoding methods. They are still read, with a note on standard error."""

from __future__ import annotations

import sys
from typing import Any

from ledpi.core.wording import one_line

METHODS = {"soft": "likelihood", "bands": "uemura"}


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
