"""Text and YAML that people write, read with one line for what is wrong."""

from __future__ import annotations

import errno
import os
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from ledpi.core.errors import CalibrationError, ConfigError, DiskFullError
from ledpi.core.files import not_written, parse_json, read_bytes, read_text, read_yaml, write_beside

_opened: list[str] = []
sys.addaudithook(lambda event, args: _opened.append(str(args[0])) if event == "open" else None)  # stays for good


@pytest.fixture
def opened() -> list[str]:
    """The names of the files that are opened from now on."""
    _opened.clear()
    return _opened


def test_a_key_given_twice_is_named_at_any_depth(tmp_path: Path) -> None:
    """YAML would take the last in silence."""
    file = tmp_path / "x.yaml"
    file.write_text("a:\n  b: 1\n  c:\n    d: 1\n    d: 2\n")
    with pytest.raises(ConfigError, match=r"x\.yaml: not valid YAML: line 5: d is there twice"):
        read_yaml(file, ConfigError)


@pytest.mark.parametrize("key", ["7", '"7"', "007"])
def test_an_id_is_the_same_in_quotes(tmp_path: Path, key: str) -> None:
    """Neither of a panel's two places may win."""
    file = tmp_path / "x.yaml"
    file.write_text(f"7: 1\n{key}: 2\n")
    with pytest.raises(ConfigError, match=r"x\.yaml: not valid YAML: line 2: 7 is there twice"):
        read_yaml(file, ConfigError)


def test_numbers_are_what_people_read(tmp_path: Path) -> None:
    """As in YAML 1.2: zeros ahead of an ID mean nothing, no colon makes hours, 3e-05 is small."""
    file = tmp_path / "x.yaml"
    numbers = {"007": 7, "010": 10, "-08": -8, "0x1F": 31, "3e-05": 3e-5, "-1.5E3": -1500.0, "2.e+2": 200.0}
    texts = {"20:50": "20:50", "1_000": "1_000", "7e": "7e", "e5": "e5", "+": "+"}
    file.write_text(f"a: [{', '.join([*numbers, *texts])}]\n")
    assert read_yaml(file, ConfigError) == {"a": [*numbers.values(), *texts.values()]}


@pytest.mark.parametrize("text", ["a: &usual {b: 1}\nd:\n  <<: *usual\n", "a: &b [1]\nc: [*b, *b]\n", "a: &b [*b]\n"])
def test_an_alias_is_refused_with_its_line(tmp_path: Path, text: str) -> None:
    """Ten lines of aliases of aliases stand for gigabytes, and one may hold itself."""
    file = tmp_path / "x.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=r"x\.yaml: not valid YAML: line [1-3]: \*aliases are not read"):
        read_yaml(file, ConfigError)


@pytest.mark.parametrize("text", ["a: " + "[" * 100_000, "- " * 100_000, "{a: " * 50_000])
def test_what_is_nested_too_deeply_is_refused(tmp_path: Path, text: str) -> None:
    """Long before it is too deep for Python."""
    file = tmp_path / "x.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match="line 1: is nested more than 32 deep"):
        read_yaml(file, ConfigError)


def test_half_a_character_is_refused(tmp_path: Path) -> None:
    """By its escape it may stand in YAML and JSON, in values and keys; no name of a file can have it."""
    file = tmp_path / "x.yaml"
    for text in ('a: 1\nmap: "\\ud800"\n', 'a: 1\n"\\udfff": 1\n'):
        file.write_text(text)
        with pytest.raises(ConfigError, match=r"x\.yaml: not valid YAML: line 2: holds half a character"):
            read_yaml(file, ConfigError)
    with pytest.raises(ValueError, match="half a character"):
        parse_json('{"file": "\\ud800"}')
    assert parse_json('"\\ud83d\\ude00"') == "\U0001f600"


@pytest.mark.parametrize("text", [f"{'k' * 999}: 1\n{'k' * 999}: 2", f"a: !{'x' * 99_999} 1"])
def test_a_long_value_does_not_make_a_long_message(tmp_path: Path, text: str) -> None:
    """Shortens what stands in the file before it is repeated."""
    file = tmp_path / "x.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError) as refused:
        read_yaml(file, ConfigError)
    assert len(str(refused.value)) < len(str(file)) + 300


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    """Nobody may ever write into it."""
    os.mkfifo(tmp_path / "x.yaml")
    with pytest.raises(ConfigError, match=r"x\.yaml: cannot be read: is a pipe, a device or the like; must be a"):
        read_text(tmp_path / "x.yaml", ConfigError)


def test_a_device_is_not_even_opened(tmp_path: Path, opened: list[str]) -> None:
    """A link to /dev/zero, say, which has no end; to open a watchdog starts it."""
    (tmp_path / "x.yaml").symlink_to("/dev/zero")
    (tmp_path / "y.yaml").write_text("{}")
    with pytest.raises(ConfigError, match="must be a regular file"):
        read_yaml(tmp_path / "x.yaml", ConfigError)
    read_yaml(tmp_path / "y.yaml", ConfigError)
    assert str(tmp_path / "y.yaml") in opened
    assert str(tmp_path / "x.yaml") not in opened


def test_a_file_may_be_just_as_large_as_is_allowed(tmp_path: Path) -> None:
    """One byte more is refused, and no more than that is read."""
    file = tmp_path / "x.txt"
    file.write_bytes(b"a" * 1000)
    assert len(read_bytes(file, ConfigError, 1000)) == 1000
    os.truncate(file, 2**40)  # without taking any room
    with pytest.raises(ConfigError, match=r"x\.txt: is too large to be read; must be at most 1,000 bytes"):
        read_bytes(file, ConfigError, 1000)


@pytest.mark.parametrize("lies_there", ["file", "link"])
def test_what_is_written_is_new(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lies_there: str) -> None:
    """Though somebody has foreseen its name, and put a file or a link there: what that leads to stays as it is."""
    monkeypatch.setattr("secrets.token_hex", lambda count: "foreseen")
    secret, fresh = tmp_path / "secret", tmp_path / ".camera.yaml.foreseen.new"
    secret.write_text("root's own")
    fresh.symlink_to(secret) if lies_there == "link" else fresh.hardlink_to(secret)
    with pytest.raises(FileExistsError):
        write_beside(tmp_path / "camera.yaml", b"ours")
    assert secret.read_text() == "root's own"
    assert fresh.exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: [", ""),
        ("a: !!timestamp x", ""),
        ("a: 2001-99-99", ""),
        ("!!python/object:os.system x", ""),
        ("a: 1\nb:\n\tc: 2\n", r"line 3: found character '\\t' that cannot start"),  # looks as right as blanks do
    ],
)
def test_what_is_no_yaml_is_one_line(tmp_path: Path, text: str, said: str) -> None:
    """Whatever the reader chokes on, the file is named, on a single line, and where it breaks."""
    file = tmp_path / "x.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=rf"x\.yaml: not valid YAML: {said}[^\n]+$"):
        read_yaml(file, ConfigError)


def test_each_kind_of_file_has_its_own_error(tmp_path: Path) -> None:
    """The one that is asked for: missing, a folder, or no UTF-8. The mark that some editors begin with is no text."""
    (tmp_path / "latin.txt").write_bytes(b"caf\xe9")
    for name, said in (("none.txt", "No such file"), ("", "Is a directory"), ("latin.txt", "byte 3 is not UTF-8")):
        with pytest.raises(CalibrationError, match=said):
            read_text(tmp_path / name, CalibrationError)
    (tmp_path / "frames.jsonl").write_bytes(b"\xef\xbb\xbf{}\n")
    assert read_text(tmp_path / "frames.jsonl", CalibrationError) == "{}\n"


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_says_what_it_has_left(tmp_path: Path, number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Asks the folder where the file was to be, as far as there is one. There may be room, and no name left."""
    full = OSError(number, os.strerror(number))
    said = not_written(tmp_path / "no/such/file", full, ConfigError)
    assert isinstance(said, DiskFullError)
    assert re.search(r"file: cannot be written: .* \(\d+\.\d MB free\); make room on it, or", str(said))
    without = SimpleNamespace(f_bavail=3, f_frsize=10**6, f_files=9, f_favail=0)
    monkeypatch.setattr(os, "statvfs", lambda _: without)
    assert "(3.0 MB free and names for no further file)" in str(not_written(tmp_path, full, ConfigError))


def test_another_refusal_is_not_a_full_disk(tmp_path: Path) -> None:
    """It does not pass by itself."""
    said = not_written(tmp_path, PermissionError(errno.EACCES, "Permission denied"), CalibrationError)
    assert type(said) is CalibrationError
    assert str(said) == f"{tmp_path}: cannot be written: Permission denied"
