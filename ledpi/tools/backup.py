"""All that makes an installation this robot's own, in a file: configuration, lens, map, dictionary, udev rule.

A zip archive: `ledpi-backup.json` says its version and what each other file in it is. How single panels blink is in the
configuration (`panels.overrides`).
"""

from __future__ import annotations

import io
import json
import lzma
import os
import re
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple

from ledpi import __version__
from ledpi.config.check import mistakes_in
from ledpi.config.settings import sections
from ledpi.core.errors import ConfigError
from ledpi.core.files import MAX_TEXT_BYTES, parse_yaml, read_bytes
from ledpi.core.wording import one_line, shortened_name
from ledpi.markers.dictionaries import FILE_ENDINGS, is_file
from ledpi.tools.calibrate.files import check_writable
from ledpi.tools.own_rule import foreign_line

VERSION = 1  # of the archive's form
CONTENTS = "ledpi-backup.json"
RULES = Path("/etc/udev/rules.d")
CALIBRATION = Path("/var/lib/ledpi")  # made by scripts/install
CONFIG, LENS, MAP, DICTIONARY, RULE = "configuration", "lens", "map", "dictionary", "udev rule"
KINDS = (LENS, MAP, DICTIONARY, RULE, CONFIG)  # in the order in which they are put back: what names the others, last
KEYS = {LENS: "camera.intrinsics", MAP: "map", DICTIONARY: "panels.dictionary"}
MOST_FILES = len(KINDS)  # one of each
MAX_BYTES = MOST_FILES * MAX_TEXT_BYTES


# What zipfile and json raise for an archive that is none: one that is locked, or packed in a way of its own, too.
_BROKEN = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, ValueError, KeyError, TypeError, AttributeError, EOFError,
           OSError, RuntimeError, struct.error, OverflowError)  # fmt: skip


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
    rules = [Kept(RULE, rule.name, read_bytes(rule, ConfigError)) for rule in sorted(RULES.glob("*-ledpi.rules"))]
    return kept + [rule for rule in rules if foreign_line(rule.content) is None][-1:]


def rules_left_out(files: Sequence[Kept]) -> list[Path]:
    """The udev rules here that `collect` did not take: with lines of other people's, or one of several."""
    taken = {file.path for file in files if file.kind == RULE}
    return [rule for rule in sorted(RULES.glob("*-ledpi.rules")) if rule.name not in taken]


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


def unpack(data: bytes, where: object) -> Backup:
    """Reads an archive, whole. Raises ConfigError, which begins with `where`, if it is none, or of a newer version."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            head = json.loads(_member(archive, CONTENTS))
            version = head["ledpi_backup"]
            if version != VERSION:
                by = f"made by ledpi {shortened_name(head.get('ledpi'))}"
                has = shortened_name(version)
                raise ConfigError(f"{where}: is a backup of version {has}, {by}; this ledpi reads version {VERSION}")
            by, made = (one_line(shortened_name(head[key])) for key in ("ledpi", "made"))
            return Backup(by, made, list(_files(archive, head["files"])))
    except _BROKEN:
        raise ConfigError(f"{where}: is no whole backup; must be a file that `ledpi backup` wrote") from None


def to_write(backup: Backup, file: Path, where: object) -> list[tuple[Path, Kept]]:
    """Returns what is other than it is here, and where it goes, if the configuration is `file`.

    Raises ConfigError, which begins with `where`, if anything that would be restored is wrong or cannot be written.
    """
    found = targets(backup, file)
    _check(backup.files, where)
    changed = [(to, kept) for to, kept in found if not to.is_file() or read_bytes(to, ConfigError) != kept.content]
    for to, _ in changed:
        if not to.parent.is_dir():
            raise ConfigError(f"{to}: there is no folder {to.parent}; make it first")
    check_writable(*(to for to, _ in changed))
    return changed


def _check(files: Sequence[Kept], where: object) -> None:
    """Raises ConfigError where what is restored would be wrong: tried in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="ledpi-restore-") as name:
        overrides = []
        for number, file in enumerate(files):
            tried = Path(name) / f"{number}-{file.kind}{next(filter(file.path.endswith, FILE_ENDINGS), '.yaml')}"
            tried.write_bytes(file.content)
            if file.kind == CONFIG:
                config = tried
            elif file.kind != RULE:
                overrides.append(f"{KEYS[file.kind]}={tried}")
        if mistakes := mistakes_in(config, overrides):
            raise ConfigError(f"{where}: {'; '.join(mistakes).replace(f'{name}/', '')}")


def targets(backup: Backup, file: Path) -> list[tuple[Path, Kept]]:
    """Returns where each file goes, if the configuration is `file`; the configuration last.

    The configuration inside says so, not the archive's own list: a lens goes where that says that a lens is. Raises
    ConfigError where that is outside of its folder, for a file that it does not name, and where one that it names is
    missing: it would be looked for on this machine.
    """
    (config,) = (kept for kept in backup.files if kept.kind == CONFIG)
    raw = parse_yaml(config.content.decode("utf-8-sig", "replace"), f"{file}, from the backup", ConfigError)
    named = _paths(raw if isinstance(raw, dict) else {})
    found = [(_target(kept, file, named), kept) for kept in backup.files]
    kinds = {kept.kind for kept in backup.files}
    for kind, path in named.items():
        if kind not in kinds:
            raise ConfigError(f"{KEYS[kind]}: {shortened_name(path)} is not in the backup, which must be whole")
    return sorted(found, key=lambda one: KINDS.index(one[1].kind))


def _target(kept: Kept, file: Path, named: Mapping[str, str]) -> Path:
    if kept.kind == CONFIG:
        return file
    if kept.kind == RULE:
        if (line := foreign_line(kept.content)) is not None:
            raise ConfigError(
                f"{kept.path}: line {line} is not of ledpi's own udev rule; put it there by hand if it is yours"
            )
        return RULES / kept.path
    path = named.get(kept.kind)
    if path is None or path != kept.path:
        raise ConfigError(
            f"{shortened_name(kept.path)}: is in the backup, but its configuration names no such {kept.kind}"
        )
    to, folders = _beside(file, path), (file.absolute().parent, CALIBRATION)
    if not any(Path(os.path.realpath(to.parent)).is_relative_to(os.path.realpath(folder)) for folder in folders):
        where = f"below {folders[0]} or {CALIBRATION}"
        raise ConfigError(
            f"{KEYS[kept.kind]}: {shortened_name(path)} in the backup: must be {where}; nothing is written elsewhere"
        )
    return to


def _files(archive: zipfile.ZipFile, contents: list[dict[str, Any]]) -> Iterator[Kept]:
    kinds = [one["kind"] for one in contents]
    if len(contents) > MOST_FILES or CONFIG not in kinds or len(set(kinds)) < len(kinds):
        raise ValueError
    for one in contents:
        kind, path = one["kind"], one["path"]
        if kind not in KINDS or not isinstance(path, str) or "\0" in path:
            raise ValueError
        if kind == RULE and not re.fullmatch(r"[A-Za-z0-9_-]{1,40}-ledpi\.rules", path):
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


def _paths(raw: dict[str, Any]) -> dict[str, str]:
    """As `_named`, of a configuration that may hold anything."""
    whole = {key: part for key, part in raw.items() if isinstance(part, dict) or key == "map"}
    try:
        return {kind: path for kind, path in _named(whole) if isinstance(path, str)}
    except (TypeError, AttributeError):
        return {}


def _beside(file: Path, path: str) -> Path:
    """Returns what the configuration `file` means by `path`."""
    return file.absolute().parent / os.path.expanduser(path)
