"""`kind: udp`, `tcp` and `stdout`: bytes to an address, a server or a pipe; and what the kernel knows of them."""

from __future__ import annotations

import errno
import fcntl
import os
import select
import socket
import ssl
import stat
import struct
import sys
import termios
from contextlib import suppress

from ledpi.config.outputs import OutputSettings
from ledpi.core.errors import TransientError
from ledpi.links.payload import BytesTarget
from ledpi.links.target import CONNECT_S, UNANSWERED_MS, UNSENT_BYTES, BridgeError, Line, TargetLostError

NOT_YET_VALID = 9  # OpenSSL's X509_V_ERR_CERT_NOT_YET_VALID: a Pi without a clock, until it has asked the network


def refused(where: str, error: ssl.SSLError) -> BridgeError | TargetLostError:
    """The error of a handshake that failed, with what to look at."""
    if isinstance(error, ssl.SSLEOFError | ssl.SSLZeroReturnError):  # as a server does that is being restarted
        return TargetLostError(f"{where}: closes the connection; is the port right for tls: true?")
    if not isinstance(error, ssl.SSLCertVerificationError):
        return BridgeError(f"{where}: speaks no TLS ({error.reason}); is the port right?")
    said = f"{where}: its certificate is not accepted ({error.verify_message})"
    if error.verify_code == NOT_YET_VALID:
        return TargetLostError(f"{said}; is this machine's clock right?")
    return BridgeError(f"{said}; renew it, or see host and ca_file")


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


class SocketTarget(BytesTarget):
    """An address, and the socket that leads there once it is open."""

    _socket: socket.socket | None = None

    def __init__(self, settings: OutputSettings) -> None:
        super().__init__(settings)
        self._host, self._port = settings.address

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()


class UdpTarget(SocketTarget):
    """An address that may or may not listen."""

    _address: tuple[object, ...] = ()

    def open(self) -> None:
        try:
            family, kind, protocol, _, self._address = socket.getaddrinfo(
                self._host, self._port, type=socket.SOCK_DGRAM
            )[0]
        except OSError as error:
            raise lost(self._host, error) from None
        self._socket = socket.socket(family, kind, protocol)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)  # host may be all of a network
        self._socket.setblocking(False)

    def tell_state(self, state: str, health: Line | None) -> None:
        """Sends it, if that can be: of what is wrong the next frame tells."""
        with suppress(BridgeError):
            super().tell_state(state, health)

    def tick(self) -> None:
        """Nothing: there is no connection."""

    def _write(self, data: bytes) -> bool:
        assert self._socket is not None
        try:
            return self._socket.sendto(data, self._address) == len(data)
        except BlockingIOError:  # no room: the next one may pass
            return False
        except OSError as error:  # no route, too long: likewise, but a person may want to know
            raise BridgeError(str(lost(self._host, error))) from None


class TcpTarget(SocketTarget):
    """One server. What it sends is read and thrown away."""

    _rest = b""  # of a frame that was begun: its end must follow

    def __init__(self, settings: OutputSettings) -> None:
        super().__init__(settings)
        self._where = f"{self._host}:{self._port}"

    def open(self) -> None:
        try:
            self._socket = socket.create_connection((self._host, self._port), CONNECT_S)
            keep_nothing_old(self._socket)
            self._socket.setblocking(False)
        except OSError as error:
            raise lost(self._where, error) from None
        self._rest = b""

    def tick(self) -> None:
        """Notices where the server has closed."""
        assert self._socket is not None
        try:
            while heard := self._socket.recv(1 << 16):
                if len(heard) < 1 << 16:
                    return
        except BlockingIOError:
            return
        except OSError as error:
            raise lost(self._where, error) from None
        raise TargetLostError(f"{self._where}: has closed the connection")

    def _write(self, data: bytes) -> bool:
        """All of it or nothing, but for a part that the kernel had no room for; that follows before anything else."""
        assert self._socket is not None
        try:
            if self._rest:
                self._rest = self._rest[self._socket.send(self._rest) :]
            if self._rest or unsent_bytes(self._socket) > UNSENT_BYTES:
                return False
            self._rest = data[self._socket.send(data) :]
        except BlockingIOError:
            return False
        except OSError as error:
            raise lost(self._where, error) from None
        return True


class StdoutTarget(BytesTarget):
    """Standard output. Where it is a pipe that nobody empties, frames are dropped."""

    def __init__(self, settings: OutputSettings) -> None:
        super().__init__(settings)
        self._output = sys.stdout.fileno()

    def open(self) -> None:
        if stat.S_ISFIFO(os.fstat(self._output).st_mode):
            fcntl.fcntl(self._output, fcntl.F_SETPIPE_SZ, UNSENT_BYTES)

    def tick(self) -> None:
        """Raises TransientError where the reader is gone, though nothing is written."""
        poll = select.poll()
        poll.register(self._output, 0)
        if any(found & select.POLLERR for _, found in poll.poll(0)):
            raise TransientError("standard output: its reader is gone")

    def close(self) -> None:
        """Nothing: it is not ours."""

    def _write(self, data: bytes) -> bool:
        """Waits for nobody to begin; what was begun is ended, however long the reader takes."""
        if not select.select((), (self._output,), (), 0)[1]:
            return False
        try:
            while data:
                data = data[os.write(self._output, data) :]
        except BrokenPipeError:
            raise TransientError("standard output: its reader is gone") from None
        return True
