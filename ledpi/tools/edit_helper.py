"""The helper that writes config.yaml for the live page, whose service may write no file, and the page's end of it.

systemd starts it at a connection (`ledpi config serve`), as a process that may write in the configuration's folder, and
in /var/lib/ledpi, and do nothing else. A request is a line of JSON, `ledpi.tools.editing.answer` says which; the answer
another one, {"says": …} or {"error": …}. Only the page's service has the group that may connect.
"""

from __future__ import annotations

import json
import logging
import os
import socket
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from ledpi.config.settings import SEARCH_PATH
from ledpi.core.errors import ConfigError, LedpiError
from ledpi.core.wording import shortened_name
from ledpi.tools.backup import MAX_BYTES
from ledpi.tools.editing import answer, is_permitted

SOCKET = Path("/run/ledpi-edit")  # of /etc/ledpi/config.yaml; of /etc/ledpi/NAME.yaml it is /run/ledpi-edit-NAME
MOST_BYTES = 2 * MAX_BYTES  # of a line: base64 makes 4 bytes of 3
REQUEST_S, ANSWER_S = 10.0, 60.0
IDLE_S = 30.0  # after which it ends: on a small computer its memory is of more use to others
_FIRST = 3  # descriptor that systemd passes

_log = logging.getLogger("ledpi.edit")


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
