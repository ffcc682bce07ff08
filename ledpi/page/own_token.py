"""The page's token where the configuration has none: made once for the service, at each start for others."""

from __future__ import annotations

import logging
import os
import re
import secrets
from contextlib import suppress
from pathlib import Path

from ledpi.core.errors import ConfigError
from ledpi.core.files import put_in_place, read_text, write_beside

_log = logging.getLogger("ledpi.view")


def kept_token() -> str:
    """Returns the one in systemd's state folder, so that an address which was kept works after a reboot, too."""
    token = secrets.token_urlsafe(24)
    folder = os.environ.get("STATE_DIRECTORY")
    if not folder:
        return token
    file = Path(folder) / "token"
    with suppress(ConfigError):  # not there yet, or of no use
        kept = read_text(file, ConfigError)
        if re.fullmatch(r"[\w-]{32}", kept, re.ASCII):
            return kept
    try:
        put_in_place(write_beside(file, token.encode()), file)
    except OSError as error:
        _log.warning("the token is for this start alone: %s: %s", file, error.strerror)
    return token
