"""`kind: tcp`: a connection to a server, a frame after the other."""

from __future__ import annotations

import socket

from ledpi.bridge.payload import BytesTarget
from ledpi.bridge.sockets import keep_nothing_old, lost, unsent_bytes
from ledpi.bridge.target import CONNECT_S, UNSENT_BYTES, TargetLostError
from ledpi.config.outputs import OutputSettings


class TcpTarget(BytesTarget):
    """One server. What it sends is read and thrown away."""

    def __init__(self, settings: OutputSettings) -> None:
        self._address = settings.address
        self._where = "{}:{}".format(*settings.address)
        super().__init__(settings)
        self._socket: socket.socket | None = None
        self._rest = b""  # of a frame that was begun: its end must follow

    def open(self) -> None:
        try:
            self._socket = socket.create_connection(self._address, CONNECT_S)
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

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()

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
