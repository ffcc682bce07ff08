"""A bag of ours → the recording that it holds, as it was, byte by byte."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import TypeVar

from ledpi.camera.recording.format import (
    FRAMES_FILE,
    HEADER_FILE,
    MAX_LINE,
    TRUTH_FILE,
    FrameLine,
    TruthLine,
    read_header,
)
from ledpi.core.dictionaries import is_file
from ledpi.core.errors import LedpiError, RecordingError, shortened
from ledpi.core.files import not_written, parse_json, writing
from ledpi.links.bags.contents import FRAME, IMAGE, METADATA, TRUTH, Compressed, Text, checked
from ledpi.links.bags.reading import Item
from ledpi.links.ros.contents import COMPRESSED_IMAGE
from ledpi.wire.diary import DIARY_FILE

Line = TypeVar("Line", FrameLine, TruthLine)


def restore_recording(words: dict[str, str], items: Iterator[Item], path: Path, out: Path) -> Iterator[int]:
    """The recording's files, as they were. A picture comes before its line; without that it is left out."""
    _begin(out, words, path)
    png, count = b"", 0
    with _File(out / FRAMES_FILE) as frames:
        for item in items:
            if item.topic == IMAGE and item.type == COMPRESSED_IMAGE:
                png = checked(Compressed, item.read(), f"{path}: {IMAGE}").data.tobytes()
            elif item.topic == FRAME:
                text = _line(item, path)
                _put(_inside(out, _parsed(text, FrameLine, path).file, path), png)
                frames.write(f"{text}\n".encode())
                count += 1
                yield count
            elif item.topic == TRUTH:
                text = _line(item, path)
                _parsed(text, TruthLine, path)
                with (out / TRUTH_FILE).open("ab") as truth:
                    truth.write(f"{text}\n".encode())


def _begin(out: Path, words: dict[str, str], path: Path) -> None:
    """Makes the folder, with a header that can be read; else nothing is left of it."""
    if HEADER_FILE not in words or any(not _is_name(name) for name in words):
        raise RecordingError(f"{path}: its metadata {METADATA} is not of a recording")
    _check_new(out)
    with writing(out, RecordingError):
        out.mkdir(parents=True, exist_ok=True)
    for name, text in words.items():
        _put(out / name, text.encode())
    try:
        read_header(out / HEADER_FILE)
    except LedpiError as error:
        for name in words:
            (out / name).unlink()
        raise RecordingError(f"{path}: {str(error).removeprefix(f'{out}/')}") from None


def _is_name(name: str) -> bool:
    """Tells whether it names a file in a folder: of its own there are a header, a diary and a dictionary."""
    return name in (HEADER_FILE, DIARY_FILE) or (Path(name).name == name and is_file(name) and name.isprintable())


def _inside(out: Path, name: str, path: Path) -> Path:
    """A picture's file. Nothing in a folder that this has made leads out of it."""
    if not name.isprintable() or len(PurePosixPath(name).parts) > 2 or not name.endswith(".png"):
        raise RecordingError(f"{path}: {FRAME}: {shortened(name)} must be a name as frames/000000.png")
    return out / name


def _line(item: Item, path: Path) -> str:
    text = checked(Text, item.read(), f"{path}: {item.topic}").data
    if len(text) > MAX_LINE or "\n" in text:
        raise RecordingError(f"{path}: {item.topic}: must be lines of at most {MAX_LINE:,} characters")
    return text


def _parsed(text: str, model: type[Line], path: Path) -> Line:
    try:
        return model.model_validate(parse_json(text))
    except ValueError:
        name = FRAME if model is FrameLine else TRUTH
        raise RecordingError(f"{path}: {name}: holds what is no line of a recording") from None


def _put(path: Path, data: bytes) -> None:
    with writing(path.parent, RecordingError):
        path.parent.mkdir(exist_ok=True)
    with _File(path) as file:
        file.write(data)


class _File:
    """A new file, whose errors are RecordingErrors."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> _File:
        try:
            self._file = self._path.open("xb", buffering=0)
        except OSError as error:
            raise self._failure(error) from None
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def write(self, data: bytes) -> None:
        try:
            view = memoryview(data)
            while view:
                view = view[self._file.write(view) :]
        except OSError as error:
            raise self._failure(error) from None

    def _failure(self, error: OSError) -> LedpiError:
        return not_written(self._path, error, RecordingError)


def _check_new(out: Path) -> None:
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise RecordingError(f"{out}: is not empty; a recording needs a new or an empty folder")
