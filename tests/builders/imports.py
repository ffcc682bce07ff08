"""Imports of ledpi's modules, read from their source."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from tests.builders import ROOT

RUN = ["ledpi.pipeline.pipeline", "ledpi.cli.run"]


def file_of(module: str, root: Path = ROOT) -> Path | None:
    path = root.joinpath(*module.split("."))
    candidates = (path.with_suffix(".py"), path / "__init__.py")
    return next((candidate for candidate in candidates if candidate.is_file()), None)


@cache
def imports_of(path: Path) -> frozenset[str]:
    """Every module that a file imports, also inside functions; `from a import b` may mean a or a.b."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute here"
            found |= {str(node.module)} | {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(found)


def reached_from(modules: Iterable[str], root: Path = ROOT, stop_at: str = "") -> dict[str, frozenset[str]]:
    """The ledpi modules that these lead to, themselves included, each with all that it imports."""
    reached: dict[str, frozenset[str]] = {}
    waiting = list(modules)
    while waiting:
        module = waiting.pop()
        path = file_of(module, root)
        if path is None or module in reached or module == stop_at:
            continue
        reached[module] = imports_of(path)
        waiting += [name for name in reached[module] if name.startswith("ledpi.")]
    return reached
