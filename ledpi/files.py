"""Reads text and YAML that people write: what is wrong in it is one line with the file's name."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from ledpi.errors import LedpiError


class _RepeatedKeyError(Exception):
    pass


class _UniqueKeys(yaml.SafeLoader):
    """YAML lets the last of two equal keys win in silence; of a panel's two places, or two exposures, neither must."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            if isinstance(key_node, yaml.ScalarNode) and key_node.value != "<<":  # what that merges in may be overruled
                key = self.construct_object(key_node)
                if key in seen:
                    raise _RepeatedKeyError(f"line {key_node.start_mark.line + 1}: {key} is there twice; each key once")
                seen.add(key)
        return super().construct_mapping(node, deep)


# Numbers as YAML 1.2, JSON and most programs write them: 3e-05. PyYAML, which reads 1.1, would take them for text.
_UniqueKeys.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"), list("-+.0123456789")
)


def read_text(path: Path, error: type[LedpiError]) -> str:
    """The file's text. Raises `error` where it cannot be read, or is not UTF-8."""
    try:
        return path.read_text(encoding="utf-8-sig")  # some editors begin a file with a mark
    except OSError as caught:
        raise error(f"{path}: cannot be read: {caught.strerror}") from None
    except UnicodeDecodeError as caught:
        raise error(f"{path}: byte {caught.start} is not UTF-8 text") from None


def read_yaml(path: Path, error: type[LedpiError]) -> Any:
    """What the file holds. Raises `error` where it cannot be read, is no YAML, or gives a key twice."""
    text = read_text(path, error)
    try:
        return yaml.load(text, _UniqueKeys)
    except _RepeatedKeyError as caught:
        raise error(f"{path}: {caught}") from None
    except yaml.MarkedYAMLError as caught:
        raise error(f"{path}: not valid YAML: {_located(caught)}") from None
    except Exception as caught:  # for a broken value (`!!timestamp x`) PyYAML lets through whatever came up
        raise error(f"{path}: not valid YAML: {' '.join(str(caught).split())}") from None


def _located(error: yaml.MarkedYAMLError) -> str:
    """As in `line 3: mapping values are not allowed here`; PyYAML's own words take four lines."""
    line = "" if error.problem_mark is None else f"line {error.problem_mark.line + 1}: "
    context = f" ({error.context})" if error.context else ""
    return f"{line}{error.problem}{context}"
