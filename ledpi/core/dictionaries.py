"""The dictionaries there are: OpenCV's predefined ones by name, others from a file in OpenCV's own form."""

from __future__ import annotations

import difflib
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ledpi.core.codewords import Dictionary
from ledpi.core.errors import ConfigError, shortened
from ledpi.core.files import parse_json, parse_yaml, read_text

FILE_ENDINGS = (".yml", ".yaml", ".json")
MIN_SIDE, MAX_SIDE = 2, 8  # cells; OpenCV keeps a codeword in 64 bits
_OPENCV_YAML = "%YAML:1.0"  # its first line, which other readers of YAML refuse


def dictionary_names() -> tuple[str, ...]:
    """The predefined square-grid ArUco dictionaries that OpenCV knows, as `DICT_4X4_50`."""
    return tuple(sorted(n for n in dir(cv2.aruco) if n.startswith("DICT_") and n[5].isdigit()))


def meant_name(name: str) -> str:
    """`did you mean DICT_4X4_50? ` of DICT_4x4_50; "" where no predefined one has a name like it."""
    close = difflib.get_close_matches(name.upper(), dictionary_names(), n=1, cutoff=0.8)
    return f"did you mean {close[0]}? " if close else ""


def is_file(name: str) -> bool:
    """Tells whether a dictionary's name is that of a file."""
    return name.endswith(FILE_ENDINGS)


def load_dictionary(name: str) -> Dictionary:
    """A predefined dictionary by OpenCV's name, or the one of a file. Raises ValueError that says what is right.

    A file is read again once it has changed: a daemon that reloads its configuration must not keep the old codewords.
    """
    if not is_file(name):
        return _predefined(name)
    path = Path(name)
    try:
        status = path.stat()
    except OSError:
        return read_dictionary(path)  # which says what is wrong
    return _read_once(path, status.st_mtime_ns, status.st_size, status.st_ino)


@lru_cache(maxsize=8)
def _read_once(path: Path, *version: int) -> Dictionary:
    return read_dictionary(path)


@cache
def _predefined(name: str) -> Dictionary:
    if name not in dictionary_names():
        raise ValueError(
            f"unknown dictionary {shortened(name)}; {meant_name(name)}known: {', '.join(dictionary_names())}, "
            f"or a file that ends in {', '.join(FILE_ENDINGS)}"
        )
    raw = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    side = raw.markerSize
    codewords = np.stack(
        [
            cv2.aruco.Dictionary.getBitsFromByteList(raw.bytesList[i : i + 1], side).astype(bool)
            for i in range(len(raw.bytesList))
        ]
    )
    codewords.flags.writeable = False
    return Dictionary(name=name, codewords=codewords)


def read_dictionary(path: Path) -> Dictionary:
    """A dictionary of one's own, in the form that OpenCV's `Dictionary.writeDictionary` writes.

    `nmarkers` (count), `markersize` (cells a side) and `marker_0`, `marker_1`, …: the cells of each codeword from the
    top left, row by row, 1 for white. Raises ValueError naming file, key, what is wrong and what would be right.
    """
    values = _values(path)
    side = _whole(values, "markersize", path, MIN_SIDE, MAX_SIDE)
    count = _whole(values, "nmarkers", path, 1, 100_000)
    codewords = np.stack([_codeword(values, f"marker_{i}", path, side) for i in range(count)])
    codewords.flags.writeable = False
    dictionary = Dictionary(name=str(path), codewords=codewords)
    _check_distinct(dictionary, path)
    return dictionary


def _values(path: Path) -> dict[str, Any]:
    """Returns what the file says of each key. Not read by OpenCV: deeply nested lists end the process in there."""
    if not path.exists():
        raise ValueError(f"{path}: no such file; must be a dictionary, as OpenCV's writeDictionary writes it")
    try:
        text = read_text(path, ConfigError)
    except ConfigError as error:
        raise ValueError(str(error)) from None
    try:
        is_json = text.lstrip().startswith("{")
        values = parse_json(text) if is_json else parse_yaml(text.removeprefix(_OPENCV_YAML), path, ConfigError)
    except (ConfigError, ValueError):
        values = None
    if not isinstance(values, dict):
        raise ValueError(f"{path}: cannot be read as a dictionary; must be YAML (first line %YAML:1.0) or JSON")
    return values


def _whole(values: dict[str, Any], key: str, path: Path, least: int, most: int) -> int:
    value = values.get(key)
    if type(value) is not int or not least <= value <= most:
        raise ValueError(f"{path}: {key}: must be a whole number from {least} to {most}")
    return value


def _codeword(values: dict[str, Any], key: str, path: Path, side: int) -> np.ndarray:
    text = values.get(key)
    if not isinstance(text, str) or len(text) != side * side or set(text) - {"0", "1"}:
        raise ValueError(f'{path}: {key}: must be {side * side} digits 0 and 1 in quotes, as "{"01" * side}…"')
    return np.array([digit == "1" for digit in text]).reshape(side, side)


def _check_distinct(dictionary: Dictionary, path: Path) -> None:
    """No codeword may look like another, or like itself turned: they could not be distinguished."""
    seen: dict[bytes, tuple[int, int]] = {}
    for number, turned in enumerate(dictionary.rotated_codewords()):
        for turns, codeword in enumerate(turned):
            before = seen.setdefault(codeword.tobytes(), (number, turns))
            if before == (number, turns):
                continue
            other = f"marker_{before[0]}" if before[0] != number else "itself"
            raise ValueError(f"{path}: marker_{number}: looks like {other} when it is turned; codewords must differ")


def opencv_dictionary(dictionary: Dictionary) -> cv2.aruco.Dictionary:
    """The same codewords for OpenCV's own detector."""
    codewords = [
        cv2.aruco.Dictionary.getByteListFromBits(codeword.astype(np.uint8)) for codeword in dictionary.codewords
    ]
    return cv2.aruco.Dictionary(np.concatenate(codewords), dictionary.cells_per_side, dictionary.correctable_cells())
