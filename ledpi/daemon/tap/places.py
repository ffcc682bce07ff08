"""The place of the tap's socket: the daemon makes it there, and clients look for it there.

Of several cameras each has a configuration, a service and a socket of its own.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import TYPE_CHECKING

from ledpi.core.errors import ConfigError, raising

if TYPE_CHECKING:  # who only follows the tap loads no pydantic
    from ledpi.config.settings import Config

AUTO = "auto"
SERVICE = Path("/run/ledpi/tap.sock")  # RuntimeDirectory=ledpi of the unit
NAME = "tap.sock"
GROUP = "ledpi"  # whose members may use the tap of the service
CAMERAS, OF_ONE_CAMERA = Path("/etc/ledpi"), "config.yaml"  # configurations of services
MAX_PATH_BYTES = 107  # that Linux gives a socket's name


def to_serve(setting: str) -> Path:
    """Returns where a daemon with this `tap.socket` listens; with `auto` its folder is there afterwards.

    Raises ConfigError where that folder cannot be made, or where others may write in it.
    """
    if setting != AUTO:
        return _short_enough(Path(setting))
    if folder := os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]:  # systemd has made it, with its mode
        return _short_enough(Path(folder) / NAME)
    path = _short_enough(_of_user()[0])
    with raising(f"tap.socket: {path.parent} cannot be made", ConfigError, OSError):
        path.parent.mkdir(mode=0o700, exist_ok=True)
    if not _is_own(path.parent):
        raise ConfigError(f"tap.socket: {path.parent} must be a folder of user {os.geteuid()} that no other may write")
    return path


def to_look() -> list[Path]:
    """Lists where a client looks for a daemon that listens at `auto`: for the service, then for its own user's.

    A folder that another user may have made is left out.
    """
    return [SERVICE, *(path for path in _of_user() if _is_own(path.parent))]


def of_config(config: Config) -> str | None:
    """Returns where clients look for the daemon that has this configuration; None where it has no tap.

    With `auto` and /etc/ledpi/NAME.yaml that is the service ledpi@NAME, one of several cameras.
    """
    file = config.file
    if config.tap.socket == AUTO and file is not None and file.parent == CAMERAS and file.name != OF_ONE_CAMERA:
        return str(SERVICE.parent.with_name(f"{SERVICE.parent.name}-{file.stem}") / NAME)
    return config.tap.socket


def _of_user() -> list[Path]:
    """The user's own places, best first."""
    folder = os.environ.get("XDG_RUNTIME_DIR", "")
    own = [Path(folder) / "ledpi" / NAME] if os.path.isabs(folder) and os.path.isdir(folder) else []
    return [*own, Path(f"/tmp/ledpi-{os.geteuid()}") / NAME]


def _is_own(folder: Path) -> bool:
    """Tells whether it is a folder, no link to one, of this user, in which no other may write."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & 0o022


def _short_enough(path: Path) -> Path:
    length = len(os.fsencode(path))
    if length > MAX_PATH_BYTES:
        raise ConfigError(f"tap.socket: {path} has {length} bytes; a socket's path must have {MAX_PATH_BYTES} at most")
    return path
