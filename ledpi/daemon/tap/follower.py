"""One client of the tap, as its server sees it: what it has asked, and what waits to be sent to it.

What waits is bounded: of frames and of health the newest only, of answers a few, after which it is not heard until it
has read them.
"""

from __future__ import annotations

import fcntl
import os
import socket
import struct
import termios
import time
from collections import deque
from typing import Literal, get_args

from ledpi.core.records import Pixels
from ledpi.daemon.tap.protocol import MAX_REQUEST_BYTES, with_dropped

Kind = Literal["health", "state", "frame"]  # of lines that nobody has asked for
_ORDER: tuple[Kind, ...] = get_args(Kind)  # in which they are sent
MOST_ANSWERS = 8  # that a client may have open: asked, or not yet read
# What lies unread in the system's buffer is old when it is read: beyond this a newer frame waits here in its place.
# As the system counts, which takes 2 kB for a short line; 0.1 s of a camera.
UNREAD_BYTES = 1 << 14
GIVEN_UP_S = 10.0  # without taking anything of what waits
_SEND_BUFFER = 1 << 17
_SO_PEERGROUPS = 59  # Linux; Python has no name for it
_GROUPS_BYTES = 1024  # Python asks for no more: 256 groups


class Follower:
    """Used by the server's thread only."""

    def __init__(self, connection: socket.socket, commanding_group: int | None) -> None:
        """`commanding_group`: whose members may give commands, beside root and the daemon's own user."""
        self.connection = connection
        connection.setblocking(False)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        self.may_command = _may_command(connection, commanding_group)
        self.open_answers = 0  # asked, and not yet ready
        self.dropped = 0
        self.greeted_by: object = None  # the daemon whose hello it has got
        self.ending = False  # closed once all is sent
        self.is_gone = False
        self._asks_no_more = False
        self._heard = bytearray()
        self._sending: deque[memoryview] = deque()  # in this order, whole
        self._latest: dict[Kind, bytes] = {}  # that waits, one of each kind
        self._took_s = time.monotonic()

    def hear(self) -> bool:
        """Takes in what has come. Returns False where the client is gone; one that only asks no more may still read."""
        if b"\n" in self._heard:
            return True
        try:
            data = self.connection.recv(MAX_REQUEST_BYTES)
        except BlockingIOError:
            return True
        except OSError:
            return False
        self._heard += data
        self._asks_no_more = not data
        return True

    def request(self) -> bytes | None:
        """The next line that it has sent, if it may ask more. Raises ValueError for one that is too long."""
        if not self.listens:
            return None
        end = self._heard.find(b"\n")
        if (len(self._heard) if end < 0 else end + 1) > MAX_REQUEST_BYTES:
            raise ValueError
        if end < 0:
            return None
        line = bytes(self._heard[:end])
        del self._heard[: end + 1]
        return line

    @property
    def has_request(self) -> bool:
        """Tells whether a line is here that may be asked for at once."""
        return self.listens and b"\n" in self._heard

    @property
    def listens(self) -> bool:
        """Tells whether it may ask more; what it sends meanwhile waits in its own buffer."""
        return not self.ending and self.open_answers + len(self._sending) < MOST_ANSWERS

    @property
    def hears(self) -> bool:
        """Tells whether there is any use in waiting for what it sends."""
        return self.listens and not self._asks_no_more

    def show(self, kind: Kind, line: bytes) -> None:
        """Queues a line in place of one of its kind that still waits; a frame that is dropped so is counted."""
        self.dropped += kind == "frame" and kind in self._latest
        self._latest[kind] = line

    def answer(self, line: bytes, raw: Pixels | bytes | None = None) -> None:
        """Queues what must arrive."""
        self._sending.append(memoryview(line))
        if raw is not None:
            self._sending.append(memoryview(raw if isinstance(raw, bytes) else raw.reshape(-1).data))

    def send(self) -> bool:
        """As much as it takes now, without waiting. Returns False where the client is gone."""
        try:
            self._send_answers()
            while not self._sending and (line := self._next()) is not None:
                self._sending.append(memoryview(line))
                self._send_answers()
        except BlockingIOError:
            return True
        except OSError:
            return False
        return not (self.ending and not self._sending)

    def _send_answers(self) -> None:
        while self._sending:
            part = self._sending[0]
            sent = self.connection.send(part)
            self._took_s = time.monotonic()
            if sent == len(part):
                self._sending.popleft()
            else:
                self._sending[0] = part[sent:]

    def _next(self) -> bytes | None:
        """Returns what is sent while no answer waits, if the client keeps up."""
        if not self._latest or self._unread() > UNREAD_BYTES:
            return None
        kind = min(self._latest, key=_ORDER.index)
        line = self._latest.pop(kind)
        return with_dropped(line, self.dropped) if kind == "frame" else line

    def _unread(self) -> int:
        """Tells how much the system keeps for it."""
        (size,) = struct.unpack("i", fcntl.ioctl(self.connection, termios.TIOCOUTQ, b"\0" * 4))
        return int(size)

    @property
    def is_blocked(self) -> bool:
        """Tells whether it must be told when there is room again."""
        return bool(self._sending)

    @property
    def waiting_bytes(self) -> int:
        """Counts all that waits here, without the system's buffer."""
        return sum(len(part) for part in (*self._latest.values(), *self._sending, self._heard))

    def is_dead(self, now_s: float) -> bool:
        """Tells whether something waits for it, and it has taken nothing for long."""
        if not (self._sending or self._latest):
            self._took_s = now_s
        return now_s - self._took_s > GIVEN_UP_S


def _may_command(connection: socket.socket, group: int | None) -> bool:
    """As the system knows the process at the other end."""
    _, uid, gid = struct.unpack("3i", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
    if uid in (0, os.geteuid()):
        return True
    return group is not None and (gid == group or group in _groups(connection))


def _groups(connection: socket.socket) -> tuple[int, ...]:
    try:
        found = connection.getsockopt(socket.SOL_SOCKET, _SO_PEERGROUPS, _GROUPS_BYTES)
    except OSError:
        return ()
    return struct.unpack(f"{len(found) // 4}i", found)
