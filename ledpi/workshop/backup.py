"""All that makes an installation this robot's own, in a file: configurations, what they name, the udev rule.

A zip archive: `ledpi-backup.json` says its version, what each other file in it is, and which units were enabled. How
single panels blink is in the configuration (`panels.overrides`). A udev rule may start programs as root (RUN+=), so
only ledpi's own is taken from an archive, with a board's own values filled in.
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
from collections.abc import Iterator, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple

from ledpi import __version__
from ledpi.config.check import mistakes_in
from ledpi.config.named_files import CERTIFICATES, DICTIONARY, LENS, MAP, NamedFile, meant, named_files, passwords
from ledpi.config.settings import sections
from ledpi.config.shipped import foreign_line
from ledpi.core.dictionaries import FILE_ENDINGS
from ledpi.core.errors import ConfigError, one_line, shortened_name
from ledpi.core.files import MAX_TEXT_BYTES, parse_json, parse_yaml, read_bytes
from ledpi.daemon.tap.places import CAMERAS, OF_ONE_CAMERA
from ledpi.workshop.calibrate.files import check_writable

VERSION = 1  # of the archive's form
CONTENTS = "ledpi-backup.json"
RULES = Path("/etc/udev/rules.d")
CALIBRATION = Path("/var/lib/ledpi")  # made by scripts/install
UNITS = Path("/etc/systemd/system")  # where `systemctl enable` puts its links
CONFIG, RULE = "configuration", "udev rule"
# In the order in which they are put back: what names the others, last.
KINDS = (LENS, MAP, DICTIONARY, CERTIFICATES, RULE, CONFIG)
EXAMPLE = "config.example.yaml"  # of scripts/install
_OWNER, _ANYBODY = 0o600, 0o666  # who reads and writes a file: at least, and at most, less the umask
MOST_FILES = 64
MAX_BYTES = 8 * MAX_TEXT_BYTES  # of all of them: unpacked, and packed
# Unpacked piece by piece. Of bzip2 and LZMA zipfile unpacks 4 kB at once, which may be gigabytes.
_BOUNDED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_UNIT = re.compile(r"ledpi(-view|-bridge)?(@[A-Za-z0-9_-]{1,80})?|ledpi-edit(@[A-Za-z0-9_-]{1,80})?\.socket")
# What zipfile and json raise for an archive that is none: one that is locked, or packed in a way of its own, too.
_BROKEN = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, ValueError, KeyError, TypeError, AttributeError, EOFError,
           OSError, RuntimeError, struct.error, OverflowError)  # fmt: skip


class Kept(NamedTuple):
    """One file of it."""

    kind: str
    path: str  # as the configuration writes it; of the configuration "", of another camera's and of a rule its name
    content: bytes
    mode: int  # who may read and write it, as one with a token is its owner's


class Backup(NamedTuple):
    """Which version of ledpi made it, when (UTC), the units that were enabled, and its files."""

    made_by: str
    made: str
    units: list[str]
    files: list[Kept]

    def configurations(self) -> Iterator[tuple[Kept, dict[str, Any]]]:
        """Each with what it says, which may be anything. Raises ConfigError where one is no YAML."""
        for kept in self.files:
            if kept.kind == CONFIG:
                text = kept.content.decode("utf-8-sig", "replace")
                raw = parse_yaml(text, f"{kept.path or OF_ONE_CAMERA} in the backup", ConfigError)
                yield kept, raw if isinstance(raw, dict) else {}


def collect(file: Path) -> list[Kept]:
    """The files of a configuration; of the service's, of other cameras' too. Raises ConfigError where one is wrong."""
    kept: dict[tuple[str, str], Kept] = {}
    for each in (file, *_other_cameras(file)):
        if mistakes := mistakes_in(each):
            raise ConfigError("; ".join(mistakes))
        name = "" if each == file else each.name
        kept[CONFIG, name] = _kept(CONFIG, name, each)
        for named in named_files(sections(each)):
            if _is_ours(at := meant(file, named.path), file):
                kept[named.kind, named.path] = _kept(named.kind, named.path, at)
    rules = [_kept(RULE, rule.name, rule) for rule in sorted(RULES.glob("*-ledpi.rules"))]
    return [*kept.values(), *[rule for rule in rules if foreign_line(rule.content) is None][-1:]]


def _kept(kind: str, path: str, at: Path) -> Kept:
    return Kept(kind, path, read_bytes(at, ConfigError), at.stat().st_mode & _ANYBODY | _OWNER)


def left_out(file: Path, files: Sequence[Kept]) -> Iterator[str]:
    """A line for each file that `collect` did not take, and a robot has."""
    taken = {(kept.kind, kept.path) for kept in files}
    for each in (file, *_other_cameras(file)):
        raw = sections(each)
        for named in named_files(raw):
            if (named.kind, named.path) not in taken:
                only = f"`ledpi restore` writes only below {file.absolute().parent} and {CALIBRATION}"
                yield f"{meant(file, named.path)} ({named.key}): is not in the backup, as {only}; keep it yourself"
        for key, path in passwords(raw):
            yield f"{meant(file, path)} ({key}): no password is in a backup; keep it yourself"
    places = {meant(file, kept.path) for kept in files}
    for each in _beside() if file.absolute() == CAMERAS / OF_ONE_CAMERA else ():
        if each not in places:
            yield f"{each}: is not in the backup: no configuration names it, and as one it has mistakes"
    for rule in sorted(RULES.glob("*-ledpi.rules")):
        if (RULE, rule.name) not in taken:
            yield f"{rule}: is not in the backup, as it is not ledpi's own udev rule with your values; keep it yourself"
    for changed in sorted(UNITS.glob("ledpi*.service.d/*")):
        yield f"{changed}: what you have changed of a unit is not in the backup; keep it yourself"


def enabled_units() -> list[str]:
    """Those of ledpi that start with this machine, by systemd's links."""
    names = {link.name.removesuffix(".service") for link in UNITS.glob("*.wants/ledpi*")}
    return sorted(name for name in names if _UNIT.fullmatch(name))


def is_service(file: Path) -> bool:
    """Tells whether a unit reads this configuration."""
    return file.absolute().parent == CAMERAS


def _other_cameras(file: Path) -> list[Path]:
    """Beside the service's configuration, those of ledpi@NAME: what else lies there, as a lens, is none."""
    if file.absolute() != CAMERAS / OF_ONE_CAMERA:
        return []
    return [each for each in _beside() if not mistakes_in(each, with_files=False)]


def _beside() -> list[Path]:
    return [each for each in sorted(CAMERAS.glob("*.yaml")) if each.name not in (OF_ONE_CAMERA, EXAMPLE)]


def pack(files: Sequence[Kept], units: Sequence[str]) -> bytes:
    """The archive. Raises ConfigError where it would be larger than `unpack` reads."""
    out = io.BytesIO()
    contents = []
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for number, kept in enumerate(files):
            name = f"{number}-{Path(kept.path).name or OF_ONE_CAMERA}"
            contents.append({"name": name, "kind": kept.kind, "path": kept.path, "mode": f"{kept.mode:o}"})
            archive.writestr(name, kept.content)
        made = datetime.now(timezone.utc).isoformat(timespec="seconds")
        head = {"ledpi_backup": VERSION, "ledpi": __version__, "made": made, "units": [*units], "files": contents}
        archive.writestr(CONTENTS, json.dumps(head, indent=1))
    if len(files) > MOST_FILES or sum(len(kept.content) for kept in files) > MAX_BYTES:
        raise ConfigError(f"{len(files)} files: must be at most {MOST_FILES}, of {MAX_BYTES:,} bytes together")
    return out.getvalue()


def unpack(data: bytes, where: object) -> Backup:
    """Reads an archive, whole. Raises ConfigError, which begins with `where`, if it is none, or of a newer version."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            head = parse_json(_member(archive, CONTENTS).decode())
            version = head["ledpi_backup"]
            if version != VERSION:
                by = f"made by ledpi {shortened_name(head.get('ledpi'))}"
                has = shortened_name(version)
                raise ConfigError(f"{where}: is a backup of version {has}, {by}; this ledpi reads version {VERSION}")
            by, made = (one_line(shortened_name(head[key])) for key in ("ledpi", "made"))
            units = [str(unit) for unit in head.get("units", [])][:MOST_FILES]
            if not all(map(_UNIT.fullmatch, units)):
                raise ValueError
            return Backup(by, made, units, list(_files(archive, head["files"])))
    except _BROKEN:
        raise ConfigError(f"{where}: is no whole backup; must be a file that `ledpi backup` wrote") from None


def to_write(backup: Backup, file: Path, where: object) -> list[tuple[Path, Kept]]:
    """Returns what is other than it is here, and where it goes, if the configuration is `file`.

    Raises ConfigError, which begins with `where`, if anything that would be restored is wrong or cannot be written.
    """
    found = targets(backup, file)
    _check(backup, where)
    changed = [(to, kept) for to, kept in found if not to.is_file() or read_bytes(to, ConfigError) != kept.content]
    for to, _ in changed:
        if not to.parent.is_dir():
            raise ConfigError(f"{to}: there is no folder {to.parent}; make it first")
    check_writable(*(to for to, _ in changed))
    return changed


def _check(backup: Backup, where: object) -> None:
    """Raises ConfigError where what is restored would be wrong: tried in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="ledpi-restore-") as name:
        tried: dict[tuple[str, str], Path] = {}
        for number, file in enumerate(backup.files):
            ending = next(filter(file.path.endswith, FILE_ENDINGS), ".yaml")
            at = tried[file.kind, file.path] = Path(name) / f"{number}-{file.kind}{ending}"
            at.write_bytes(file.content)
        (password := Path(name) / "password").write_text("no password is in a backup")
        password.chmod(0o600)
        for config, raw in backup.configurations():
            overrides = [f"{key}={password}" for key, _ in passwords(raw)]
            for each in named_files(raw):
                if (each.kind, each.path) in tried:
                    overrides.append(f"{each.key}={tried[each.kind, each.path]}")
            if mistakes := mistakes_in(tried[config.kind, config.path], overrides):
                raise ConfigError(f"{where}: {'; '.join(mistakes).replace(f'{name}/', '')}")


def targets(backup: Backup, file: Path) -> list[tuple[Path, Kept]]:
    """Returns where each file goes, if the configuration is `file`; the configurations last.

    The configurations inside say so, not the archive's own list: a lens goes where one of them says that a lens is.
    Raises ConfigError where that is outside of its folder, and for a file that none names, or a place that two have.
    """
    named = [each for _, raw in backup.configurations() for each in named_files(raw)]
    found: dict[Path, tuple[Path, Kept]] = {}
    for kept in sorted(backup.files, key=lambda one: KINDS.index(one.kind)):
        to = _target(kept, file, named)
        _, first = found.setdefault(Path(os.path.realpath(to.parent)) / to.name, (to, kept))
        if first.content != kept.content:
            raise ConfigError(f"{to}: is two files of the backup, {first.kind} and {kept.kind}; must be one")
    return list(found.values())


def _target(kept: Kept, file: Path, named: Sequence[NamedFile]) -> Path:
    if kept.kind == CONFIG:
        return file.absolute().parent / kept.path if kept.path else file
    if kept.kind == RULE:
        if (line := foreign_line(kept.content)) is not None:
            raise ConfigError(
                f"{kept.path}: line {line} is not of ledpi's own udev rule; put it there by hand if it is yours"
            )
        return RULES / kept.path
    key = next((each.key for each in named if (each.kind, each.path) == (kept.kind, kept.path)), None)
    if key is None:
        raise ConfigError(
            f"{shortened_name(kept.path)}: is in the backup, but its configuration names no such {kept.kind}"
        )
    to = meant(file, kept.path)
    if not _is_ours(to, file):
        where = f"below {file.absolute().parent} or {CALIBRATION}"
        raise ConfigError(
            f"{key}: {shortened_name(kept.path)} in the backup: must be {where}; nothing is written elsewhere"
        )
    return to


def _is_ours(to: Path, file: Path) -> bool:
    """Tells whether `restore` writes there."""
    folder = Path(os.path.realpath(to.parent))
    return any(folder.is_relative_to(os.path.realpath(each)) for each in (file.absolute().parent, CALIBRATION))


def _files(archive: zipfile.ZipFile, contents: list[dict[str, Any]]) -> Iterator[Kept]:
    named = [(one["kind"], one["path"]) for one in contents]
    if len(contents) > MOST_FILES or (CONFIG, "") not in named or len(set(named)) < len(named):
        raise ValueError
    if sum(kind == RULE for kind, _ in named) > 1:
        raise ValueError
    left = MAX_BYTES
    for one in contents:
        kind, path = one["kind"], one["path"]
        if kind not in KINDS or not isinstance(path, str) or "\0" in path:
            raise ValueError
        if kind == RULE and not re.fullmatch(r"[A-Za-z0-9_-]{1,40}-ledpi\.rules", path):
            raise ValueError
        if kind == CONFIG and path and not re.fullmatch(r"[A-Za-z0-9_-]{1,60}\.yaml", path):
            raise ValueError
        mode = int(one.get("mode", f"{_ANYBODY:o}"), 8)
        kept = Kept(kind, path, _member(archive, one["name"]), mode & _ANYBODY | _OWNER)
        left -= len(kept.content)
        if left < 0:
            raise ValueError
        yield kept


def _member(archive: zipfile.ZipFile, name: str) -> bytes:
    if archive.getinfo(name).compress_type not in _BOUNDED:
        raise ValueError
    with archive.open(name) as member:  # which checks the CRC at its end
        content = member.read(MAX_TEXT_BYTES + 1)
    if len(content) > MAX_TEXT_BYTES:
        raise ValueError
    return content
