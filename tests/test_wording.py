"""Text for people: one line, and nouns that suit their number."""

from __future__ import annotations

import pytest

from ledpi.errors import ConfigError
from ledpi.wording import counted


def test_an_error_is_one_line() -> None:
    """Whatever a file name or a key holds, and letters of any alphabet stay as they are."""
    assert str(ConfigError("a\nb\tö: c\x1b[0m")) == r"a\nb\tö: c\x1b[0m"


@pytest.mark.parametrize(("count", "text"), [(0, "0 panels"), (1, "1 panel"), (2, "2 panels")])
def test_a_noun_suits_its_number(count: int, text: str) -> None:
    """One is singular; none is plural."""
    assert counted(count, "panel") == text
