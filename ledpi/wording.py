"""How text for people is put: in one line, and with nouns that suit their number."""

from __future__ import annotations


def one_line(text: str) -> str:
    """`text` with line breaks, and whatever else does not print, as escapes: file names and keys may hold them."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def counted(count: int, noun: str) -> str:
    """As in `1 panel`, `0 panels`, `2 panels`, for nouns that take an s."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
