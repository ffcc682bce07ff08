"""`kind: udp`: a datagram for each frame. Nobody answers, so nothing ever waits."""

from __future__ import annotations

import socket

from ledpi.bridge.payload import BytesTarget
from ledpi.bridge.sockets import lost
from ledpi.config.outputs import OutputSettings


class UdpTarget(BytesTarget):
    """An address that may or may not listen."""

    def __init__(self, settings: OutputSettings) -> None:
        self._host, self._port = settings.address
        super().__init__(settings)
        self._socket: socket.socket | None = None
        self._address: tuple[object, ...] = ()

    def open(self) -> None:
        try:
            family, kind, protocol, _, self._address = socket.getaddrinfo(
                self._host, self._port, type=socket.SOCK_DGRAM
            )[0]
        except OSError as error:
            raise lost(self._host, error) from None
        self._socket = socket.socket(family, kind, protocol)
        self._socket.setblocking(False)

    def tick(self) -> None:
        """Nothing: there is no connection."""

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()

    def _write(self, data: bytes) -> bool:
        assert self._socket is not None
        try:
            return not data or self._socket.sendto(data, self._address) == len(data)
        except OSError:  # no route, no room: the next one may pass
            return False
