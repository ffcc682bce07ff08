"""All clients of the tap: who comes, who asks, who takes what is sent, and who is gone."""

from __future__ import annotations

import errno
import grp
import os
import select
import socket
import stat
import time
import weakref
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from ledpi.core.errors import ConfigError
from ledpi.daemon.tap.follower import Follower
from ledpi.daemon.tap.places import GROUP
from ledpi.daemon.tap.protocol import (
    AT_ONCE,
    MAX_REQUEST_BYTES,
    Request,
    RequestError,
    error,
    read_request,
    write_line,
)

_BACKLOG = 64
MOST_FOLLOWERS = 64
_REFUSED_S = 0.1  # after which a connection is tried again that the system had no descriptor for


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


class Bell:
    """Ends a `wait`, from any thread. It closes once nobody has it: before, its number might become another file's."""

    def __init__(self) -> None:
        self._fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        weakref.finalize(self, os.close, self._fd).atexit = False

    def fileno(self) -> int:
        """For poll."""
        return self._fd

    def ring(self) -> None:
        """Never waits."""
        with suppress(OSError):
            os.eventfd_write(self._fd, 1)

    def silence(self) -> None:
        """After it has rung, or not."""
        with suppress(BlockingIOError):
            os.eventfd_read(self._fd)


class Crowd:
    """Used by the server's thread only. `bell` ends `wait`."""

    def __init__(self, listening: Listening, bell: Bell) -> None:
        self._listening, self._bell = listening, bell
        self._followers: dict[int, Follower] = {}
        self._events: dict[int, int] = {}
        self._epoll = select.epoll()
        for fd in (listening.socket.fileno(), bell.fileno()):
            self._epoll.register(fd, select.EPOLLIN)

    def __iter__(self) -> Iterator[Follower]:
        return iter(self._followers.values())

    def __len__(self) -> int:
        return len(self._followers)

    def wait(self, seconds: float) -> None:
        """Until something comes, from a client or with the bell."""
        if any(follower.has_request for follower in self):
            seconds = 0.0
        for fd, events in self._epoll.poll(seconds):
            if fd == self._bell.fileno():
                self._bell.silence()
            elif fd == self._listening.socket.fileno():
                self._welcome()
            elif events & (select.EPOLLHUP | select.EPOLLERR) or (
                events & select.EPOLLIN and not self._followers[fd].hear()
            ):
                self._part(fd)

    def wait_for_bell(self, seconds: float) -> None:
        """Until the bell rings; what clients send, read or want waits."""
        poll = select.poll()
        poll.register(self._bell, select.POLLIN)
        if poll.poll(1e3 * seconds):
            self._bell.silence()

    def requests(self) -> Iterator[tuple[Follower, Request]]:
        """Yields what clients ask, one line of each, after all that is AT_ONCE. What is no request is answered here."""
        for follower in list(self):
            while (request := self._request_of(follower)) is not None:
                yield follower, request
                if request.do not in AT_ONCE:
                    break

    def _request_of(self, follower: Follower) -> Request | None:
        try:
            line = follower.request()
        except ValueError:
            text = f"a line without an end; a request must be one line of {MAX_REQUEST_BYTES} bytes at most"
            follower.answer(write_line(error(text)))
            follower.ending = True
            return None
        try:
            return read_request(line) if line else None
        except RequestError as mistake:
            follower.answer(write_line(error(str(mistake), mistake.id)))
            return None

    def send(self) -> None:
        """Sends what each takes now; who is gone, or takes nothing for long, is left."""
        now_s = time.monotonic()
        for fd, follower in list(self._followers.items()):
            if not follower.send() or follower.is_dead(now_s):
                self._part(fd)
            else:
                self._watch(fd, follower)

    @property
    def waiting_bytes(self) -> int:
        """Counts all that waits for any of them."""
        return sum(follower.waiting_bytes for follower in self)

    def close(self) -> None:
        """Parts with all."""
        for fd in list(self._followers):
            self._part(fd)
        self._epoll.close()

    def _welcome(self) -> None:
        try:
            connection, _ = self._listening.socket.accept()
        except BlockingIOError:  # gone again
            return
        except OSError:  # no descriptor left, say; it stays in the queue
            time.sleep(_REFUSED_S)
            return
        fd = connection.fileno()
        self._followers[fd] = follower = Follower(connection, self._listening.group)
        if len(self) > MOST_FOLLOWERS:
            follower.answer(write_line(error(f"{MOST_FOLLOWERS} clients are here already; end one of them")))
            follower.ending = True
        self._epoll.register(fd, 0)
        self._events[fd] = 0
        self._watch(fd, follower)

    def _watch(self, fd: int, follower: Follower) -> None:
        events = select.EPOLLIN * follower.hears | select.EPOLLOUT * follower.is_blocked
        if events != self._events[fd]:
            self._epoll.modify(fd, events)
            self._events[fd] = events

    def _part(self, fd: int) -> None:
        follower = self._followers.pop(fd)
        del self._events[fd]
        with suppress(OSError):
            self._epoll.unregister(fd)
        with suppress(OSError):
            follower.connection.shutdown(socket.SHUT_RDWR)
        follower.is_gone = True
        follower.connection.close()
