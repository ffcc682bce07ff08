"""The place of a configuration's daemon: of several cameras each has its own service."""

from __future__ import annotations

from ledpi.config.settings import SEARCH_PATH, Config
from ledpi.daemon.tap.places import AUTO, NAME, SERVICE

CAMERAS, OF_ONE_CAMERA = SEARCH_PATH[-1].parent, SEARCH_PATH[-1].name  # configurations of services


def of_config(config: Config) -> str | None:
    """Returns where clients look for the daemon that has this configuration; None where it has no tap.

    With `auto` and /etc/ledpi/NAME.yaml that is the service ledpi@NAME, one of several cameras.
    """
    file = config.file
    if config.tap.socket == AUTO and file is not None and file.parent == CAMERAS and file.name != OF_ONE_CAMERA:
        return str(SERVICE.parent.with_name(f"{SERVICE.parent.name}-{file.stem}") / NAME)
    return config.tap.socket
