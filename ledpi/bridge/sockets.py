"""Connections that carry poses: what the kernel is told of them, and asked."""

from __future__ import annotations

import errno
import fcntl
import socket
import struct
import termios

from ledpi.bridge.target import UNANSWERED_MS, UNSENT_BYTES, TargetLostError


def keep_nothing_old(connection: socket.socket) -> None:
    """Small buffers, no gathering of small packets, and an end to what is not answered."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, UNSENT_BYTES)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, UNANSWERED_MS)


def unsent_bytes(connection: socket.socket) -> int:
    """Bytes that the other side's kernel has not yet acknowledged."""
    answer = fcntl.ioctl(connection.fileno(), termios.TIOCOUTQ, b"\0" * 4)
    return int(struct.unpack("i", answer)[0])


def lost(where: str, error: OSError) -> TargetLostError:
    """The error of an address that cannot be reached, with what to look at."""
    hints = {
        errno.ECONNREFUSED: "nothing listens there; is it started, and the port right?",
        errno.EHOSTUNREACH: "no such machine answers; are the address and the network right?",
        errno.ENETUNREACH: "there is no network to it",
    }
    if isinstance(error, socket.gaierror):
        return TargetLostError(f"{where}: no machine of that name is known ({error.strerror}); is host right?")
    if isinstance(error, TimeoutError):
        return TargetLostError(f"{where}: does not answer; are host and port right?")
    said = error.strerror or str(error)
    return TargetLostError(f"{where}: {hints.get(error.errno or 0, said)}")
