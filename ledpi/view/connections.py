"""A bounded number of connections, each with a time limit: what a web server meets on a network.

Whoever has not shown the token gives way: a connection that comes when all places are taken gets the oldest such one.
So connections that ask for nothing, from wherever they come, keep nobody out.
"""

from __future__ import annotations

import io
import socket
import threading
import time
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

MOST = 48  # connections at once; a page has two
IDLE_S = 20.0  # within which the next request must be there, with all of its body
SEND_S = 10.0  # within which an answer must be taken

_BUSY = (
    b"HTTP/1.1 503 Service Unavailable\r\nContent-Type: text/plain; charset=utf-8\r\nConnection: close\r\n"
    b"Retry-After: 5\r\n\r\ntoo many viewers; close a page and try again\n"
)


class BoundedServer(ThreadingHTTPServer):
    """A thread for each connection, MOST of them. Where all are taken, the oldest without the token gives way."""

    daemon_threads = True
    block_on_close = False
    request_queue_size = 64
    allow_reuse_address = True

    def __init__(self, address: tuple[str, int], handler: type[BaseHTTPRequestHandler]) -> None:
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        self._changing = threading.Lock()
        self._unknown: dict[socket.socket, None] = {}  # connections that have not shown the token, the oldest first
        self._trusted: set[socket.socket] = set()
        super().__init__(address, handler)

    def server_bind(self) -> None:
        """Without asking the network for this machine's name, which may take long."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.bind(self.server_address)
        self.server_address = self.socket.getsockname()
        self.server_name, self.server_port = str(self.server_address[0]), int(self.server_address[1])

    def process_request(self, request: Any, client_address: Any) -> None:
        """In a thread of its own; one too many is told so, and closed."""
        oldest = None
        with self._changing:
            if is_full := len(self._unknown) + len(self._trusted) >= MOST:
                oldest = next(iter(self._unknown), None)
            if oldest is not None:
                del self._unknown[oldest]
            if not is_full or oldest is not None:
                self._unknown[request] = None
        if is_full and oldest is None:
            with suppress(OSError):
                request.settimeout(0.2)
                request.sendall(_BUSY)
            self.shutdown_request(request)
            return
        if oldest is not None:
            with suppress(OSError):  # it is gone already
                oldest.shutdown(socket.SHUT_RDWR)  # which ends its thread
        try:
            super().process_request(request, client_address)
        except RuntimeError:  # no thread is to be had
            self._leave(request)
            raise

    def trust(self, request: socket.socket) -> None:
        """The connection has shown the token: it keeps its place."""
        with self._changing:
            if request in self._unknown:
                del self._unknown[request]
                self._trusted.add(request)

    def _leave(self, request: socket.socket) -> None:
        with self._changing:
            self._unknown.pop(request, None)
            self._trusted.discard(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Gives its place back, however it ends."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._leave(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A connection that breaks is no fault of ours; anything else is told."""
        import logging
        import sys

        error = sys.exc_info()[1]
        if not isinstance(error, OSError):
            logging.getLogger("ledpi.view").error("a request failed: %r", error)


class Hurried(io.RawIOBase):
    """Reads a socket until a moment that is set for each request: bytes that drip do not hold a thread."""

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self.until_s = time.monotonic() + IDLE_S

    def hurry(self) -> None:
        """The next request must be there within IDLE_S."""
        self.until_s = time.monotonic() + IDLE_S

    def readable(self) -> bool:
        """It is."""
        return True

    def readinto(self, into: Any) -> int:
        """As RawIOBase's. Raises TimeoutError when the time is over."""
        left_s = self.until_s - time.monotonic()
        if left_s <= 0:
            raise TimeoutError("the request did not come in time")
        self._socket.settimeout(left_s)
        count = self._socket.recv_into(into)
        self._socket.settimeout(SEND_S)
        return count
