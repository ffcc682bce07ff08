"""Text for people: one line, and nouns that suit their number."""

from __future__ import annotations

import pytest

from ledpi.core.errors import LINE_LENGTH, VALUE_LENGTH, ConfigError, counted, one_line, shortened, shortened_name


def test_an_error_is_one_line() -> None:
    """Whatever a file name or a key holds, and letters of any alphabet stay as they are."""
    assert str(ConfigError("a\nb\tö: c\x1b[0m")) == r"a\nb\tö: c\x1b[0m"


@pytest.mark.parametrize("name", ["n" * 99_999, "\0" * 99_999])
def test_a_line_is_never_long(name: str) -> None:
    """Begins with which file it is, and ends with what would be right, also of a path of any length."""
    said = one_line(f"config.yaml: map: {name}: cannot be read: File name too long")
    assert len(said) == LINE_LENGTH
    assert said.startswith("config.yaml: map: ")
    assert said.endswith(": cannot be read: File name too long")
    assert one_line("n" * LINE_LENGTH) == "n" * LINE_LENGTH


@pytest.mark.parametrize(("count", "text"), [(0, "0 panels"), (1, "1 panel"), (2, "2 panels")])
def test_a_noun_suits_its_number(count: int, text: str) -> None:
    """One is singular; none is plural."""
    assert counted(count, "panel") == text


def test_a_short_value_is_written_whole() -> None:
    """As Python writes it; names as they are."""
    assert shortened({"a": [1, None, 2.5, "x"]}) == "{'a': [1, None, 2.5, 'x']}"
    assert (shortened_name("camera"), shortened_name(7)) == ("camera", "7")


HUGE = ["x" * 10**6, [[1] * 10**6] * 9, {"k" * 999: 1}, 10**5000, -(16**9999), {10**5000: 0}]


@pytest.mark.parametrize("value", HUGE, ids=range(len(HUGE)))
def test_a_value_of_any_size_is_cut(value: object) -> None:
    """Also a number of so many digits that Python does not write it."""
    assert len(shortened(value)) <= VALUE_LENGTH
    assert len(shortened_name(value)) <= VALUE_LENGTH
