"""Docstrings say what a thing is or does: they begin with a noun or a verb."""

from __future__ import annotations

import ast

from tests.builders import ROOT

NEITHER = ("Of", "What", "Where", "Whether", "How")
FOLDERS = ("ledpi", "evaluation", "ros", "tests")


def test_they_begin_with_a_noun_or_a_verb() -> None:
    """Each module's, class's and function's of these folders."""
    begins = [
        (f"{path.relative_to(ROOT)}:{node.body[0].lineno}", text.split()[0])
        for folder in FOLDERS
        for path in sorted((ROOT / folder).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        and (text := ast.get_docstring(node))
    ]
    assert len(begins) > 1000
    assert [at for at, word in begins if word in NEITHER] == []
