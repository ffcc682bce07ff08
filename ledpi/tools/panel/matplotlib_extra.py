"""matplotlib is an optional extra: what cannot be drawn without it says so."""

from __future__ import annotations

import importlib.util

from ledpi.core.errors import ConfigError
from ledpi.core.wording import install_command


def require_matplotlib(what: str) -> None:
    """Raises ConfigError, with the way to get it, where matplotlib is not installed."""
    if importlib.util.find_spec("matplotlib") is None:
        raise ConfigError(f"{what}: must have matplotlib, which is not installed: {install_command('panel')}")
