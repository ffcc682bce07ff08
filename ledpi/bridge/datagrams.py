"""`kind: udp`: a datagram for each frame, or for each MAVLink packet. Nobody answers, so nothing ever waits."""

from __future__ import annotations

import socket
from contextlib import suppress

from ledpi.bridge.payload import BytesTarget
from ledpi.bridge.sockets import lost
from ledpi.bridge.target import BridgeError, Line
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
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)  # host may be all of a network
        self._socket.setblocking(False)

    def tell_state(self, state: str, health: Line | None) -> None:
        """Sends it, if that can be: of what is wrong the next frame tells."""
        with suppress(BridgeError):
            super().tell_state(state, health)

    def tick(self) -> None:
        """Nothing: there is no connection."""

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()

    def _write(self, data: bytes) -> bool:
        assert self._socket is not None
        try:
            return self._socket.sendto(data, self._address) == len(data)
        except BlockingIOError:  # no room: the next one may pass
            return False
        except OSError as error:  # no route, too long: likewise, but a person may want to know
            raise BridgeError(str(lost(self._host, error))) from None
