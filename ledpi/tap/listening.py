"""The tap's socket as a file: made where no other daemon listens, and taken away again."""

from __future__ import annotations

import errno
import grp
import os
import socket
import stat
from contextlib import suppress
from pathlib import Path

from ledpi.core.errors import ConfigError
from ledpi.tap.places import GROUP

_BACKLOG = 64


class Listening:
    """A listening socket, not blocking. What is no socket is never replaced, nor a socket at which somebody answers."""

    def __init__(self, path: Path) -> None:
        """Raises ConfigError where that cannot be."""
        self.path = path
        self.group = _gid(GROUP)
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK)
        try:
            _clear(path)
            self.socket.bind(os.fspath(path))
            # A service's umask would leave it to its own user, which nobody else can be.
            path.chmod(0o660 if os.getegid() == self.group else 0o600)
            self.socket.listen(_BACKLOG)
            found = path.lstat()
        except OSError as error:
            self.socket.close()
            raise ConfigError(
                f"tap.socket: {path}: {error.strerror or error}; must be a path to make a socket at, or null"
            ) from None
        except ConfigError:
            self.socket.close()
            raise
        self._inode = (found.st_dev, found.st_ino)

    @property
    def is_there(self) -> bool:
        """Tells whether its file still is where clients look for it: whoever clears /tmp takes it away."""
        try:
            found = self.path.lstat()
        except OSError:
            return False
        return (found.st_dev, found.st_ino) == self._inode

    def close(self) -> None:
        """Takes the file away, if it still is this socket's. Safe to call twice."""
        self.socket.close()
        with suppress(OSError):
            if self.is_there:
                self.path.unlink()


def _clear(path: Path) -> None:
    """Takes away the socket of a daemon that has not ended as it should. Raises ConfigError, OSError."""
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(mode):
        raise ConfigError(f"tap.socket: {path} is there, and is no socket; must be another path, or null")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK) as probe:
        answer = probe.connect_ex(os.fspath(path))
    if answer == errno.ECONNREFUSED:
        path.unlink()
    elif answer in (0, errno.EAGAIN, errno.EINPROGRESS):
        raise ConfigError(f"tap.socket: {path}: another daemon listens there; must be another path, or null")
    elif answer:
        raise OSError(answer, os.strerror(answer))


def _gid(name: str) -> int | None:
    try:
        return grp.getgrnam(name).gr_gid
    except KeyError:
        return None
