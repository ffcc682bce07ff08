"""A password from a file of its own, so that it is in no configuration, log or listing."""

from __future__ import annotations

import stat
from pathlib import Path

from ledpi.bridge.target import BridgeError
from ledpi.core.files import read_text


def read_password(path: Path) -> str:
    """The first line. Raises BridgeError where everybody may read the file, or it is empty."""
    text = read_text(path, BridgeError)
    if path.stat().st_mode & stat.S_IROTH:
        raise BridgeError(f"{path}: everybody may read it; chmod o-r, and let the group ledpi read it")
    password = text.partition("\n")[0].rstrip("\r")
    if not password:
        raise BridgeError(f"{path}: is empty; its first line must be the password")
    return password
