"""Docstrings and C's comments say what a thing is or does: they begin with a noun or a verb."""

from __future__ import annotations

import re

from tests.builders import ROOT

# After the line that begins its class or function, or at the module's beginning.
DOCSTRING = re.compile(r'(?:\A|:\n) *"""(\w+)')
COMMENT = re.compile(r"/\*+\s*(\w+)")
NEITHER = {"Of", "What", "Where", "Whether", "How"}
FOLDERS = ("ledpi", "evaluation", "ros", "tests")


def test_they_begin_with_a_noun_or_a_verb() -> None:
    """Each module's, class's and function's of these folders."""
    begins = [
        (f"{path.relative_to(ROOT)}:{text.count(chr(10), 0, found.start(1)) + 1}", found[1])
        for folder in FOLDERS
        for path in sorted((ROOT / folder).rglob("*.py"))
        for text in [path.read_text(encoding="utf-8")]
        for found in DOCSTRING.finditer(text)
    ]
    assert len(begins) > 1000
    assert [each for each in begins if each[1] in NEITHER] == []


def test_those_in_c_do_so_too() -> None:
    """Each comment of the core and of the firmware, also behind a line."""
    begins = [
        (f"{path.relative_to(ROOT)}:{text.count(chr(10), 0, found.start(1)) + 1}", found[1].capitalize())
        for folder in ("ledpi", "firmware")
        for path in sorted((ROOT / folder).rglob("*.[ch]"))
        for text in [path.read_text(encoding="utf-8")]
        for found in COMMENT.finditer(text)
    ]
    assert len(begins) > 400
    assert [each for each in begins if each[1] in NEITHER] == []
