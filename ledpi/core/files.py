"""Reads files that may hold anything, and writes new ones where others may write, as in /var/lib/ledpi.

Only regular files are read, and no more of them than is allowed: a pipe would be waited for, a device has no end. What
is wrong with one is one line with its name. What is written survives a power cut: whole under its name, or not there.
"""

from __future__ import annotations

import errno
import fcntl
import glob
import json
import os
import re
import secrets
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import yaml

from ledpi.core.errors import DiskFullError, LedpiError
from ledpi.core.wording import shortened_name

# Of what a person writes, or a calibration: a map of a thousand panels takes 170 kB. YAML needs 400 times its size.
MAX_TEXT_BYTES = 256 * 1024
MAX_DEPTH = 32  # of lists and mappings in each other
MAX_QUOTED = 200  # characters of PyYAML's own words, which may repeat a value
FULL = {errno.ENOSPC: "the disk is full", errno.EDQUOT: "this user's share of the disk is used up"}
HALF = "holds half a character (\\ud800 to \\udfff by itself), as no file's name or text can"
MAKE_ROOM = "make room on it, or write to another one"


def _encodable(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


class _PlainYaml(yaml.SafeLoader):
    """YAML without what surprises: keys that are there twice, the last of which would win; aliases, for gigabytes."""

    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            raise self._refusal("*aliases are not read: write it out")
        if self._depth > MAX_DEPTH:
            raise self._refusal(f"is nested more than {MAX_DEPTH} deep")
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def construct_scalar(self, node: yaml.ScalarNode | yaml.MappingNode) -> Any:
        value = super().construct_scalar(node)
        if isinstance(value, str) and not _encodable(value):
            raise yaml.MarkedYAMLError(problem=HALF, problem_mark=node.start_mark)
        return value

    def _refusal(self, what: str) -> yaml.MarkedYAMLError:
        return yaml.MarkedYAMLError(problem=what, problem_mark=self.peek_event().start_mark)  # type: ignore[no-untyped-call]

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            if isinstance(key_node, yaml.ScalarNode) and key_node.value != "<<":  # what that merges in may be overruled
                key = self.construct_object(key_node)
                key = str(key) if isinstance(key, int) else key  # an ID is the same ID in quotes
                if key in seen:
                    twice = f"{shortened_name(key)} is there twice; each key once"
                    raise yaml.MarkedYAMLError(problem=twice, problem_mark=key_node.start_mark)
                seen.add(key)
        return super().construct_mapping(node, deep)


# Numbers as YAML 1.2, JSON and people write them. To PyYAML (1.1) 010 is eight, 20:50 is 1250, and 3e-05 is text.
_NUMBERS = {
    "tag:yaml.org,2002:int": r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+",
    "tag:yaml.org,2002:float": r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+|[0-9]+(?=[eE]))([eE][-+]?[0-9]+)?"
    r"|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
}
_PlainYaml.yaml_implicit_resolvers = {
    first: [(tag, form) for tag, form in forms if tag not in _NUMBERS]
    for first, forms in _PlainYaml.yaml_implicit_resolvers.items()
}
for _tag, _form in _NUMBERS.items():
    _PlainYaml.add_implicit_resolver(_tag, re.compile(f"(?:{_form})$"), list("-+.0123456789"))


def _whole_number(loader: _PlainYaml, node: yaml.ScalarNode) -> int:
    text = loader.construct_scalar(node)
    return int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))


_PlainYaml.add_constructor("tag:yaml.org,2002:int", _whole_number)


def read_bytes(path: Path, error: type[LedpiError], at_most: int = MAX_TEXT_BYTES) -> bytes:
    """Returns what the file holds. Raises `error` where it cannot be read, is no regular file, or exceeds `at_most`."""
    try:
        _check_regular(path.stat())  # before it is opened, as to open a device may set it going
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC), "rb") as file:
            _check_regular(os.fstat(file.fileno()))  # and not another thing by now
            content = file.read(at_most + 1) or b""
    except OSError as caught:
        raise error(f"{path}: cannot be read: {caught.strerror}") from None
    if len(content) > at_most:
        raise error(f"{path}: is too large to be read; must be at most {at_most:,} bytes")
    return content


def _check_regular(status: os.stat_result) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "is a pipe, a device or the like; must be a regular file")


def write_beside(path: Path, content: bytes, *, like: os.stat_result | None = None, mode: int = 0o666) -> Path:
    """Writes a new file in `path`'s folder for `put_in_place`, on the disk on return. Raises OSError; nothing is left.

    `like`: whose owner, group and mode it has before it holds anything; else `mode`, less the umask. Nobody foresees
    its name, and it must be new: a link of another user's would lead who calibrates as root elsewhere.
    """
    fresh = path.with_name(f".{path.name}.{secrets.token_hex(8)}.new")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    with open(os.open(fresh, flags, 0o600 if like is not None else mode), "wb") as file:
        try:
            if like is not None:
                _make_alike(file.fileno(), like)
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        except BaseException:
            fresh.unlink(missing_ok=True)
            raise
    return fresh


def _make_alike(descriptor: int, like: os.stat_result) -> None:
    own = os.fstat(descriptor)
    if (own.st_uid, own.st_gid) != (like.st_uid, like.st_gid):
        try:
            os.fchown(descriptor, like.st_uid, like.st_gid)
        except PermissionError:
            raise PermissionError(errno.EPERM, "belongs to another user, and must stay theirs; use sudo") from None
    os.fchmod(descriptor, stat.S_IMODE(like.st_mode))


def remove_unfinished(path: Path) -> None:
    """Removes what writers of `path` that were killed have left beside it. Only who has the folder's lock may."""
    for left in path.parent.glob(f".{glob.escape(path.name)}.*.new"):
        if re.fullmatch(r"[0-9a-f]{16}", left.name.split(".")[-2]):
            with suppress(OSError):
                left.unlink()


@contextmanager
def locked(folder: Path, wait_s: float = 30.0) -> Iterator[None]:
    """Holds a folder: of two who change a file in it the second sees what the first wrote. OSError after `wait_s`.
    One that cannot be locked, as another user's or of a file system without locks, is not held.
    """
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError:
        yield
        return
    try:
        _lock(descriptor, wait_s)
        yield
    finally:
        os.close(descriptor)


def _lock(descriptor: int, wait_s: float) -> None:
    until = time.monotonic() + wait_s
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            if time.monotonic() > until:
                raise OSError(errno.EBUSY, "another program is changing files in this folder") from None
            time.sleep(0.01)
        except OSError:
            return


def put_in_place(fresh: Path, path: Path) -> None:
    """Gives what `write_beside` wrote its name, over an older file, in one step. Raises OSError; nothing is left."""
    try:
        fresh.replace(path)
    except OSError:
        fresh.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Puts a folder's names on the disk, where its file system has a way to, and we may read it. Raises OSError."""
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except PermissionError:
        return
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:  # as network file systems say
            raise
    finally:
        os.close(descriptor)


@contextmanager
def writing(path: Path, kind: type[LedpiError]) -> Iterator[Path]:
    """Raises what the system says while `path` is written as `not_written` has it."""
    try:
        yield path
    except OSError as error:
        raise not_written(path, error, kind) from None


def not_written(
    path: Path, error: OSError, kind: type[LedpiError], where: str | None = None, what: str = "cannot be written"
) -> LedpiError:
    """The error of a file that could not be written, DiskFullError or `kind`; it begins with `where`, else `path`."""
    full = FULL.get(error.errno or 0)
    if full is None:
        return kind(f"{where or path}: {what}: {error.strerror or error}")
    return DiskFullError(f"{where or path}: {what}: {full}{_left(path)}; {MAKE_ROOM}")


@contextmanager
def nothing_left(path: Path) -> Iterator[None]:
    """Removes a new file for which there was no room: where there is some, the same may be done again."""
    try:
        yield
    except DiskFullError:
        path.unlink(missing_ok=True)
        raise


def _left(path: Path) -> str:
    """Says what the disk of a file has left. It may have room, and names for no further file."""
    there = next((folder for folder in (path, *path.absolute().parents) if folder.exists()), path)
    try:
        status = os.statvfs(there)
    except OSError:
        return ""
    names = " and names for no further file" if status.f_files and not status.f_favail else ""
    return f" ({status.f_bavail * status.f_frsize / 1e6:.1f} MB free{names})"


def read_text(path: Path, error: type[LedpiError], at_most: int = MAX_TEXT_BYTES) -> str:
    """The file's text. Raises `error` where it cannot be read as `read_bytes` does, or is not UTF-8."""
    try:
        return read_bytes(path, error, at_most).decode("utf-8-sig")  # some editors begin a file with a mark
    except UnicodeDecodeError as caught:
        raise error(f"{path}: byte {caught.start} is not UTF-8 text") from None


def read_yaml(path: Path, error: type[LedpiError]) -> Any:
    """Returns what the file holds. Raises `error` where it cannot be read, is no YAML, or gives a key twice."""
    return parse_yaml(read_text(path, error), path, error)


def parse_yaml(text: str, where: object, error: type[LedpiError]) -> Any:
    """Returns what the text says. Raises `error`, which begins with `where`, as `read_yaml` does."""
    try:
        return yaml.load(text, _PlainYaml)
    except yaml.MarkedYAMLError as caught:
        raise error(f"{where}: not valid YAML: {_located(caught)}") from None
    except Exception as caught:  # for a broken value (`!!timestamp x`) PyYAML lets through whatever came up
        raise error(f"{where}: not valid YAML: {' '.join(str(caught)[:MAX_QUOTED].split())}") from None


def parse_json(text: str) -> Any:
    """Returns what it says. Raises ValueError where it is no JSON, too deeply nested, or holds half a character."""
    try:
        values = json.loads(text)
    except RecursionError:
        raise ValueError("is nested too deeply") from None
    if "\\u" in text and not _encodable(json.dumps(values, ensure_ascii=False)):
        raise ValueError(HALF)
    return values


def _located(error: yaml.MarkedYAMLError) -> str:
    """As in `line 3: mapping values are not allowed here`; PyYAML's own words take four lines."""
    line = "" if error.problem_mark is None else f"line {error.problem_mark.line + 1}: "
    context = f" ({error.context})" if error.context else ""
    return f"{line}{error.problem}{context}"[:MAX_QUOTED]
