"""Changing single keys of config.yaml: comments, order and all else stay, and so does the older file."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ledpi.config.mistakes import SECRET
from ledpi.core.errors import CalibrationError
from ledpi.core.files import parse_yaml, read_text
from ledpi.tools.calibrate.files import changing, check_writable, write_locked

Key = tuple[str | int, ...]  # ("panels", "overrides", 7, "black_hz")


def check_changeable(*files: Path) -> None:
    """Raises CalibrationError where `change_config` cannot write one of `files`: before the long work, not after it."""
    check_writable(*files)


def change_config(path: Path, changes: Mapping[Key, Any], check: Callable[[], None] = lambda: None) -> Path | None:
    """Sets keys of a YAML file, and makes sections that are missing. Returns the file in which the older one is kept.

    `check` may refuse the change; nobody else changes the file between that and the writing. Raises CalibrationError
    where the file cannot be changed without losing something.
    """
    with changing(path):
        check()
        return write_locked(path, changed_safely(read_text(path, CalibrationError), changes, path))


def changed_safely(text: str, changes: Mapping[Key, Any], where: object) -> str:
    """As `changed_yaml`. Raises CalibrationError, which begins with `where`, if another key would change, too."""
    changed = changed_yaml(text, changes)
    wanted = parse_yaml(text, where, CalibrationError) or {}
    for key, value in changes.items():
        _set(wanted, key, value)
    if parse_yaml(changed, where, CalibrationError) != wanted:
        shown = {".".join(map(str, key)): value for key, value in changes.items()}
        named = ", ".join(key if key.endswith(SECRET) else f"{key}: {value}" for key, value in shown.items())
        raise CalibrationError(f"{where}: cannot be changed without touching other keys; set by hand: {named}")
    return changed


def changed_yaml(text: str, changes: Mapping[Key, Any]) -> str:
    """The text with keys set, by ruamel.yaml, which keeps comments."""
    editor = _editor()
    editor.preserve_quotes = True
    editor.width = 4096  # no line is broken that was whole
    editor.representer.add_representer(type(None), lambda to, _: to.represent_scalar("tag:yaml.org,2002:null", "null"))
    tree = editor.load(text)
    for key, value in changes.items():
        _set(tree, key, _in_one_line(value))
    out = io.StringIO()
    editor.dump(tree, out)
    return out.getvalue()


def _editor() -> Any:
    from ruamel.yaml import YAML  # takes 50 ms

    return YAML()


def _in_one_line(value: Any) -> Any:
    """As in [7, 23]."""
    from ruamel.yaml.comments import CommentedSeq

    if not isinstance(value, (list, tuple)):
        return value
    items = CommentedSeq(value)
    items.fa.set_flow_style()
    return items


def _set(tree: Any, key: Key, value: Any) -> None:
    *sections, last = key
    for name in sections:
        if tree.get(name) is None:
            tree[name] = {}
        tree = tree[name]
    tree[last] = value
