"""The files that a configuration names, which may hold anything: for a backup, and for outputs."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ledpi.core.dictionaries import is_file
from ledpi.core.errors import LedpiError
from ledpi.core.files import read_text

if TYPE_CHECKING:
    import ssl

LENS, MAP, DICTIONARY, CERTIFICATES = "lens", "map", "dictionary", "certificates"


class NamedFile(NamedTuple):
    """A file: what it is, the key that names it, and its path as it is written there."""

    kind: str
    key: str
    path: Any  # text, of those that are given out


def named_files(raw: dict[str, Any]) -> Iterator[NamedFile]:
    """Those that `ledpi backup` keeps."""
    words = _section(raw, "panels").get("dictionary")
    found: list[NamedFile] = [
        NamedFile(LENS, "camera.intrinsics", _section(raw, "camera").get("intrinsics")),
        NamedFile(MAP, "map", raw.get("map")),
        NamedFile(DICTIONARY, "panels.dictionary", words if isinstance(words, str) and is_file(words) else ""),
    ]
    outputs = _section(raw, "outputs")
    found += [NamedFile(CERTIFICATES, f"outputs.{name}.ca_file", _of(outputs, name, "ca_file")) for name in outputs]
    yield from (named for named in found if isinstance(named.path, str) and named.path)


def passwords(raw: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Key and path of each file that holds one: no backup does."""
    outputs = _section(raw, "outputs")
    for name in outputs:
        if isinstance(path := _of(outputs, name, "password_file"), str):
            yield f"outputs.{name}.password_file", path


def meant(file: Path, path: str) -> Path:
    """Returns what the configuration `file` means by `path`."""
    return file.absolute().parent / os.path.expanduser(path)


def _section(raw: dict[str, Any], key: str) -> dict[str, Any]:
    part = raw.get(key)
    return part if isinstance(part, dict) else {}


def _of(outputs: dict[str, Any], name: str, key: str) -> Any:
    return _section(outputs, name).get(key)


def read_password(path: Path, error: type[LedpiError]) -> str:
    """The first line. Raises `error` where everybody may read the file, or it is empty."""
    text = read_text(path, error)
    if path.stat().st_mode & stat.S_IROTH:
        raise error(f"{path}: everybody may read it; chmod o-r, and let the group ledpi read it")
    password = text.partition("\n")[0].rstrip("\r")
    if not password:
        raise error(f"{path}: is empty; its first line must be the password")
    return password


def tls_context(ca_file: Path | None, error: type[LedpiError]) -> ssl.SSLContext:
    """One that checks the other side by `ca_file`, or by the system's authorities. Raises `error`."""
    import ssl  # which a daemon does without

    try:
        return ssl.create_default_context(cafile=None if ca_file is None else str(ca_file))
    except OSError as caught:
        said = caught.strerror or caught
        raise error(f"{ca_file}: no certificates can be read from it ({said}); must be PEM") from None
