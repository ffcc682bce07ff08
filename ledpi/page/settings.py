"""The configuration for the page: each key with its documentation, and, where that is permitted, its changes."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ledpi.config.check import mistakes_in
from ledpi.config.mistakes import SECRET
from ledpi.config.origins import COMMAND_LINE, DEFAULT, values_of
from ledpi.config.settings import load_config, sections
from ledpi.config.shipped import documented
from ledpi.core.errors import LedpiError, TapError
from ledpi.page.guard import NotOfferedError
from ledpi.page.hub import Hub
from ledpi.workshop.backup import MAX_BYTES
from ledpi.workshop.calibrate.files import newest_kept
from ledpi.workshop.editing import answer, ask, is_permitted, packed_without_token, socket_of

RELOAD_S = 70.0  # the daemon says after 60 s that its files are not there


class Settings:
    """Those of one file; from any thread."""

    def __init__(self, hub: Hub, file: Path | None, overrides: Sequence[str]) -> None:
        """`overrides`: as of --set, with which `ledpi view` was started."""
        self._hub, self._overrides = hub, overrides
        self._file = None if file is None else file.absolute()

    def told(self) -> dict[str, Any]:
        """Each key, its value, and where that is from: of the file where it may be changed here, else of the daemon."""
        running, says = {}, ""
        try:
            running = self._hub.config()
        except TapError as error:
            says = str(error)
        try:
            file, _ = self._offered()
            if others := {origin for _, origin in running.values()} - {DEFAULT, COMMAND_LINE, str(file)}:
                says = f"the daemon runs with {others.pop()}, not with this file"
            return {"keys": _of_file(file, running), "says": says, "edit": _edit(file)}
        except NotOfferedError as error:
            keys = [_row(key, value, True, origin) for key, (value, origin) in running.items() if key in documented()]
            return {"keys": keys, "says": says, "edit": None, "why_not": str(error)}

    def change(self, request: Mapping[str, Any]) -> str:
        """As `ledpi.workshop.editing.answer`, by the helper where this process may not. Raises LedpiError."""
        file, helper = self._offered()
        return answer(file, request) if helper is None else ask(helper, request)

    def reload(self) -> dict[str, Any]:
        """Has the daemon read its file again; nothing to say. Raises LedpiError where it refuses."""
        self._offered()
        if self._hub.ask("reload", RELOAD_S) is None:
            raise TapError("the daemon does not answer")
        return {}

    def backup(self) -> bytes:
        """The archive, without the token. Raises LedpiError."""
        return packed_without_token(self._offered()[0])

    def _offered(self) -> tuple[Path, Path | None]:
        """Returns the file, and the helper's socket where this process may not write. Raises NotOfferedError."""
        file = self._file
        if file is None:
            raise NotOfferedError("there is no configuration file; `ledpi config init` writes one")
        try:
            if not is_permitted(file, self._overrides):
                raise NotOfferedError(f"view.edit is not true in {file}")
        except LedpiError as error:
            raise NotOfferedError(str(error)) from None
        if os.access(file.parent, os.W_OK):
            return file, None
        helper = socket_of(file)
        if helper is not None and os.access(helper, os.W_OK):
            return file, helper
        unit = "" if helper is None else helper.name.replace("edit-", "edit@")
        remedy = unit and f"; for its service: sudo systemctl enable --now {unit}.socket"
        raise NotOfferedError(f"ledpi view may not write {file}{remedy}")


def _of_file(file: Path, running: Mapping[str, tuple[Any, str]]) -> list[dict[str, Any]]:
    """The rows of a file; `waits`: the daemon still runs with another value, until it reads the file again."""
    raw, loaded, rows = sections(file), dict[str, Any](), []
    with suppress(LedpiError):  # the page says what is wrong with it
        loaded = values_of(load_config(file))
    for key in documented():
        value, given = _find(raw, key)
        now, origin = running.get(key, (None, DEFAULT))
        if origin == COMMAND_LINE:
            rows.append(_row(key, now, True, origin))
            continue
        waits = key in running and key in loaded and now != loaded[key]
        rows.append(_row(key, value, given, str(file) if given else DEFAULT) | {"waits": waits})
    return rows


def _row(key: str, value: Any, given: bool, origin: str) -> dict[str, Any]:
    shown = {"key": key, "text": _shown(key, value, given), "from": origin, "secret": key.endswith(SECRET)}
    return shown | documented()[key]._asdict()


def _shown(key: str, value: Any, given: bool) -> str:
    """As YAML takes it, in one line; a secret is only said to be there."""
    if key.endswith(SECRET):
        return "not set" if value is None else "set"
    if not given:
        return documented()[key].default
    if isinstance(value, float):
        return f"{value:.15g}"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)


def _find(raw: Any, key: str) -> tuple[Any, bool]:
    """The value of a key in a file, and whether it is there."""
    for name in key.split("."):
        if not isinstance(raw, dict) or name not in raw:
            return None, False
        raw = raw[name]
    return raw, True


def _edit(file: Path) -> dict[str, Any]:
    """The file that changes go to, what is wrong with it now, and what `undo` would bring back."""
    older = newest_kept(file)
    undo = None if older is None else {"to": older.name, "changes": _differences(file, older)}
    return {"file": str(file), "mistakes": mistakes_in(file), "undo": undo, "most_bytes": MAX_BYTES}


def _differences(file: Path, older: Path) -> list[str]:
    try:
        now, before = sections(file), sections(older)
    except LedpiError as error:
        return [str(error)]
    changed = [key for key in documented() if _find(now, key) != _find(before, key)]
    return [f"{key}: {_shown(key, *_find(now, key))} → {_shown(key, *_find(before, key))}" for key in changed]
