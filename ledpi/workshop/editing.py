"""Changes of config.yaml: of keys, back to the older file, back to a backup. For `ledpi config set` and the page.

The page has no right to write. systemd starts a helper at a connection (`ledpi config serve`), as a process that may
write in the configuration's folder, and in /var/lib/ledpi, and do nothing else. A request is a line of JSON,
`answer` says which; the answer another one, {"says": …} or {"error": …}. Only the page's service may connect.
"""

from __future__ import annotations

import base64
import binascii
import json
import logging
import os
import socket
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ledpi.config.check import mistakes_in, mistakes_in_text
from ledpi.config.named_files import named_files
from ledpi.config.overrides import apply_override, parse_override
from ledpi.config.settings import SEARCH_PATH, sections
from ledpi.core.errors import ConfigError, LedpiError, shortened_name
from ledpi.core.files import parse_yaml, read_bytes
from ledpi.core.linux import lost_at_reboot
from ledpi.workshop import backup
from ledpi.workshop.calibrate import files

_TOKEN = ("view", "token")
_APPLIED = {"view": "start ledpi view again to apply it", "outputs": "start its bridge again to apply it"}

SOCKET = Path("/run/ledpi-edit")  # of /etc/ledpi/config.yaml; of /etc/ledpi/NAME.yaml it is /run/ledpi-edit-NAME
MOST_BYTES = 2 * backup.MAX_BYTES  # of a line: base64 makes 4 bytes of 3
REQUEST_S, ANSWER_S = 10.0, 60.0
IDLE_S = 30.0  # after which it ends: on a small computer its memory is of more use to others
_FIRST = 3  # descriptor that systemd passes
_log = logging.getLogger("ledpi.edit")


def is_permitted(file: Path, overrides: Sequence[str] = ()) -> bool:
    """Asks a file, which may have mistakes, whether the page may change it. Raises ConfigError where it is no file."""
    raw = sections(file)
    for item in overrides:
        apply_override(raw, item)
    return _view(raw).get("edit") is True


def set_keys(file: Path, items: Sequence[str]) -> Path | None:
    """Sets KEY=VALUE… if the whole file is right afterwards. Returns where the older one is kept. Raises LedpiError."""
    changes = dict(parse_override(item) for item in items)
    files.check_writable(file)

    def check() -> None:
        if mistakes := mistakes_in(file, items, with_files=False):
            raise ConfigError("; ".join(mistakes))

    return files.change_config(file, changes, check)


def undo(file: Path, to: str) -> None:
    """Brings back the newest older file, if its name is `to`, and keeps the one that is there. Raises LedpiError."""
    with files.changing(file):
        older = files.newest_kept(file)
        if older is None or older.name != to:
            raise ConfigError(f"{file}: somebody else has changed it; look again")
        content = read_bytes(older, ConfigError)
        if mistakes := mistakes_in_text(content.decode("utf-8-sig", "replace"), str(older)):
            raise ConfigError("; ".join(mistakes))
        files.write_locked(file, content)


def packed_without_token(file: Path) -> bytes:
    """A backup that may lie about. Raises LedpiError."""
    kept = [each._replace(content=_with_token(each, None)) for each in backup.collect(file)]
    return backup.pack(kept, backup.enabled_units() if backup.is_service(file) else [])


def restore(file: Path, archive: bytes) -> list[str]:
    """Puts back a backup, but for a udev rule; a token stays where it brings none. Says what. Raises LedpiError.

    Nothing is looked for on this machine, as who asks may not read all of it, and another camera's file must permit it.
    """
    saved, said = backup.unpack(archive, "backup"), []
    brought = {(kept.kind, kept.path) for kept in saved.files}
    for named in (each for _, raw in saved.configurations() for each in named_files(raw)):
        if (named.kind, named.path) not in brought:
            raise ConfigError(
                f"{named.key}: {shortened_name(named.path)} is not in the backup, which must be whole here"
            )
    changed = backup.to_write(saved, file, "backup")
    for to, kept in changed:
        if kept.kind == backup.CONFIG and kept.path and to.exists() and not is_permitted(to):
            raise ConfigError(f"{to}: view.edit: must be true")
    for to, kept in changed:
        if kept.kind == backup.RULE:
            said.append(f"{to} is left as it is: only sudo ledpi restore writes it")
            continue
        own = _view(sections(to)).get("token") if kept.kind == backup.CONFIG and to.exists() else None
        files.write_keeping_old(to, kept.content if own is None else _with_token(kept, own), mode=kept.mode)
        said.append(f"{kept.kind}: {to}")
    return said or ["everything is there already"]


def _with_token(kept: backup.Kept, token: str | None) -> bytes:
    """The content, if it is a configuration with the token in place of none, or with none in place of one."""
    text = kept.content.decode("utf-8-sig", "replace")
    if kept.kind == backup.CONFIG:
        own = _view(parse_yaml(text, "backup", ConfigError)).get("token")
        if (own is None) != (token is None):
            return files.changed_safely(text, {_TOKEN: token}, "backup").encode()
    return kept.content


def _view(raw: Any) -> Mapping[str, Any]:
    view = raw.get("view") if isinstance(raw, dict) else None
    return view if isinstance(view, dict) else {}


def answer(file: Path, request: Mapping[str, Any]) -> str:
    """Does `set` (a `key` to a `value`, YAML), `undo` (`to` an older file's name) or `restore` (an `archive`, base64).

    Says what was done. Raises LedpiError.
    """
    match request:
        case {"do": "set", "key": str(key), "value": str(value)}:
            set_keys(file, [f"{key}={value}"])
            applied = _APPLIED.get(key.partition(".")[0], "") if key != "view.edit" else ""
            return "; ".join(filter(None, (f"{key}: saved", applied, lost_at_reboot(file))))
        case {"do": "undo", "to": str(to)}:
            undo(file, to)
            return "the file is as it was before"
        case {"do": "restore", "archive": str(archive)}:
            try:
                return "; ".join(restore(file, base64.b64decode(archive, validate=True)))
            except binascii.Error:
                pass
    raise ConfigError("must be set with key and value, undo with to, or restore with an archive in base64")


def socket_of(file: Path) -> Path | None:
    """Returns where the helper for a service's configuration listens; None for any other file."""
    usual = SEARCH_PATH[-1]
    if file.parent != usual.parent:
        return None
    return SOCKET if file.name == usual.name else SOCKET.with_name(f"{SOCKET.name}-{file.stem}")


def passed_socket() -> socket.socket:
    """The listening socket that systemd passes. Raises ConfigError where it has passed none."""
    if os.environ.get("LISTEN_PID") != str(os.getpid()) or os.environ.get("LISTEN_FDS") != "1":
        raise ConfigError("is started by systemd alone: sudo systemctl enable --now ledpi-edit.socket")
    return socket.socket(fileno=_FIRST)


def serve_edits(file: Path, listener: socket.socket, idle_s: float = IDLE_S) -> None:
    """Answers one after the other, until nobody has asked for a while."""
    listener.settimeout(idle_s)
    while True:
        try:
            connection, _ = listener.accept()
        except TimeoutError:
            return
        with connection, suppress(OSError):  # who has asked may be gone
            connection.settimeout(REQUEST_S)
            with connection.makefile("rb") as lines:
                said = _answer(file, lines.readline(MOST_BYTES))
            connection.sendall(json.dumps(said).encode() + b"\n")


def _answer(file: Path, line: bytes) -> dict[str, str]:
    try:
        request = json.loads(line)
        if not isinstance(request, dict):
            raise ValueError
        if not is_permitted(file):
            raise ConfigError(f"{file}: view.edit: must be true")
        said = {"says": answer(file, request)}
    except (ValueError, RecursionError):
        return {"error": "a request must be a line of JSON"}
    except LedpiError as error:
        return {"error": str(error)}
    _log.info("edited %s %s", request["do"], shortened_name(request.get("key", "")))
    return said


def ask(path: Path, request: Mapping[str, Any]) -> str:
    """Has the helper do it; returns what it says. Raises LedpiError."""
    try:
        with socket.socket(socket.AF_UNIX) as connection:
            connection.settimeout(ANSWER_S)
            connection.connect(str(path))
            connection.sendall(json.dumps(request).encode() + b"\n")
            with connection.makefile("rb") as lines:
                told = json.loads(lines.readline(MOST_BYTES))
    except (OSError, ValueError) as error:
        what = getattr(error, "strerror", None) or "no answer"
        raise ConfigError(f"{path}: {what}; journalctl -u ledpi-edit says more") from None
    if "says" not in told:
        raise ConfigError(str(told.get("error")))
    return str(told["says"])
