"""All that makes an installation this robot's own, in a file: configuration, lens, map, dictionary, udev rule.

A zip archive: `ledpi-backup.json` says its version and what each other file in it is. How single panels blink is in the
configuration (`panels.overrides`).
"""

from __future__ import annotations

import io
import json
import os
import re
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple

from ledpi import __version__
from ledpi.config.check import mistakes_in
from ledpi.config.settings import sections
from ledpi.core.errors import ConfigError
from ledpi.core.files import MAX_TEXT_BYTES, read_bytes
from ledpi.markers.dictionaries import is_file

VERSION = 1  # of the archive's form
CONTENTS = "ledpi-backup.json"
RULES = Path("/etc/udev/rules.d")
CONFIG, LENS, MAP, DICTIONARY, RULE = "configuration", "lens", "map", "dictionary", "udev rule"
KINDS = (LENS, MAP, DICTIONARY, RULE, CONFIG)  # in the order in which they are put back: what names the others, last
MOST_FILES = 16
MAX_BYTES = MOST_FILES * MAX_TEXT_BYTES


class Kept(NamedTuple):
    """One file of it."""

    kind: str
    path: str  # as the configuration writes it; of the configuration "", of a udev rule its name
    content: bytes


class Backup(NamedTuple):
    """Which version of ledpi made it, when (UTC), and its files."""

    made_by: str
    made: str
    files: list[Kept]


def collect(file: Path) -> list[Kept]:
    """The files of the configuration at `file`. Raises ConfigError where it, or a file that it names, is wrong."""
    if mistakes := mistakes_in(file):
        raise ConfigError("; ".join(mistakes))
    kept = [Kept(CONFIG, "", read_bytes(file, ConfigError))]
    for kind, path in _named(sections(file)):
        kept.append(Kept(kind, path, read_bytes(_beside(file, path), ConfigError)))
    kept += [Kept(RULE, rule.name, read_bytes(rule, ConfigError)) for rule in sorted(RULES.glob("*-ledpi.rules"))]
    return kept


def pack(files: Sequence[Kept]) -> bytes:
    """The archive."""
    out = io.BytesIO()
    contents = []
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for number, kept in enumerate(files):
            name = f"{number}-{Path(kept.path).name or 'config.yaml'}"
            contents.append({"name": name, "kind": kept.kind, "path": kept.path})
            archive.writestr(name, kept.content)
        made = datetime.now(timezone.utc).isoformat(timespec="seconds")
        head = {"ledpi_backup": VERSION, "ledpi": __version__, "made": made, "files": contents}
        archive.writestr(CONTENTS, json.dumps(head, indent=1))
    return out.getvalue()


def unpack(path: Path) -> Backup:
    """Reads an archive, whole. Raises ConfigError where it is none, or of a newer version."""
    data = read_bytes(path, ConfigError, MAX_BYTES)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            head = json.loads(_member(archive, CONTENTS))
            version = head["ledpi_backup"]
            if version != VERSION:
                by = f"made by ledpi {head.get('ledpi')}"
                raise ConfigError(f"{path}: is a backup of version {version}, {by}; this ledpi reads version {VERSION}")
            return Backup(str(head["ledpi"]), str(head["made"]), list(_files(archive, head["files"])))
    except (zipfile.BadZipFile, zlib.error, ValueError, KeyError, TypeError, AttributeError, EOFError):
        raise ConfigError(f"{path}: is no whole backup; must be a file that `ledpi backup` wrote") from None


def targets(backup: Backup, file: Path) -> list[tuple[Path, Kept]]:
    """Returns where each file goes, if the configuration is `file`; the configuration last."""
    return sorted(((_target(kept, file), kept) for kept in backup.files), key=lambda one: KINDS.index(one[1].kind))


def _target(kept: Kept, file: Path) -> Path:
    if kept.kind == CONFIG:
        return file
    return RULES / kept.path if kept.kind == RULE else _beside(file, kept.path)


def _files(archive: zipfile.ZipFile, contents: list[dict[str, Any]]) -> Iterator[Kept]:
    if len(contents) > MOST_FILES or [one["kind"] for one in contents].count(CONFIG) != 1:
        raise ValueError
    for one in contents:
        kind, path = one["kind"], one["path"]
        if kind not in KINDS or not isinstance(path, str) or "\0" in path:
            raise ValueError
        if kind == RULE and not re.fullmatch(r"[\w-]+-ledpi\.rules", path):
            raise ValueError
        yield Kept(kind, path, _member(archive, one["name"]))


def _member(archive: zipfile.ZipFile, name: str) -> bytes:
    with archive.open(name) as member:  # which checks the CRC at its end
        content = member.read(MAX_TEXT_BYTES + 1)
    if len(content) > MAX_TEXT_BYTES:
        raise ValueError
    return content


def _named(raw: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Kind and path of each file that a right configuration names, as it is written there."""
    camera, panels = raw.get("camera") or {}, raw.get("panels") or {}
    words = panels.get("dictionary", "")
    named = {LENS: camera.get("intrinsics"), MAP: raw.get("map"), DICTIONARY: words if is_file(words) else None}
    yield from ((kind, path) for kind, path in named.items() if path is not None)


def _beside(file: Path, path: str) -> Path:
    """Returns what the configuration `file` means by `path`."""
    return file.absolute().parent / os.path.expanduser(path)
