"""Text and YAML that people write, read with one line for what is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from ledpi.errors import CalibrationError, ConfigError
from ledpi.files import read_text, read_yaml


def test_a_key_given_twice_is_named_at_any_depth(tmp_path: Path) -> None:
    """YAML would take the last in silence."""
    file = tmp_path / "x.yaml"
    file.write_text("a:\n  b: 1\n  c:\n    d: 1\n    d: 2\n")
    with pytest.raises(ConfigError, match=r"x\.yaml: line 5: d is there twice"):
        read_yaml(file, ConfigError)


@pytest.mark.parametrize(
    ("text", "value"),
    [("3e-05", 3e-5), ("-1.5E3", -1500.0), ("2.e+2", 200.0), (".5e1", 5.0), ("7e", "7e"), ("e5", "e5")],
)
def test_powers_of_ten_are_numbers(tmp_path: Path, text: str, value: float | str) -> None:
    """As JSON and Python's repr write a small coefficient of a lens; what is not quite one stays text."""
    file = tmp_path / "x.yaml"
    file.write_text(f"a: [0.1, {text}]\n")
    assert read_yaml(file, ConfigError) == {"a": [0.1, value]}


def test_what_is_merged_in_may_be_overruled(tmp_path: Path) -> None:
    """A key beside `<<` is not one given twice."""
    file = tmp_path / "x.yaml"
    file.write_text("a: &usual {b: 1, c: 2}\nd:\n  <<: *usual\n  b: 3\n")
    assert read_yaml(file, ConfigError)["d"] == {"b": 3, "c": 2}


@pytest.mark.parametrize("text", ["a: [", "a: !!timestamp x", "a: 2001-99-99", "!!python/object:os.system x"])
def test_what_is_no_yaml_is_one_line(tmp_path: Path, text: str) -> None:
    """Whatever the reader chokes on, the file is named, on a single line."""
    file = tmp_path / "x.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=r"x\.yaml: not valid YAML: [^\n]+$"):
        read_yaml(file, ConfigError)


def test_where_the_yaml_breaks_is_told_by_its_line(tmp_path: Path) -> None:
    """A tab, which looks as right as blanks do."""
    file = tmp_path / "x.yaml"
    file.write_text("a: 1\nb:\n\tc: 2\n")
    with pytest.raises(ConfigError, match=r"x\.yaml: not valid YAML: line 3: found character '\\t' that cannot start"):
        read_yaml(file, ConfigError)


def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path: Path) -> None:
    """Some editors begin every file with one."""
    file = tmp_path / "frames.jsonl"
    file.write_bytes(b"\xef\xbb\xbf{}\n")
    assert read_text(file, ConfigError) == "{}\n"


def test_each_kind_of_file_has_its_own_error(tmp_path: Path) -> None:
    """The one that is asked for: missing, a folder, or no UTF-8."""
    (tmp_path / "latin.txt").write_bytes(b"caf\xe9")
    for name, said in (("none.txt", "No such file"), ("", "Is a directory"), ("latin.txt", "byte 3 is not UTF-8")):
        with pytest.raises(CalibrationError, match=said):
            read_text(tmp_path / name, CalibrationError)
