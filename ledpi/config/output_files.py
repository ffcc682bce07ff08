"""The files that outputs name: a password, which is so in no configuration, log or listing, and certificates."""

from __future__ import annotations

import ssl
import stat
from pathlib import Path

from ledpi.core.errors import LedpiError
from ledpi.core.files import read_text


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
    try:
        return ssl.create_default_context(cafile=None if ca_file is None else str(ca_file))
    except (OSError, ssl.SSLError) as caught:
        said = caught.strerror or caught
        raise error(f"{ca_file}: no certificates can be read from it ({said}); must be PEM") from None
