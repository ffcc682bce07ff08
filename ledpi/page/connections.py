"""A bounded number of connections, each with a time limit: what a web server meets on a network.

Whoever has not shown the token gives way: a connection that comes when all places are taken gets the oldest such one.
So connections that ask for nothing, from wherever they come, keep nobody out.
"""

from __future__ import annotations

import io
import json
import socket
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, ClassVar
from urllib.parse import SplitResult, parse_qs, urlsplit

from ledpi import __version__
from ledpi.core.errors import LedpiError, TapError, TransientError
from ledpi.page.guard import HEADERS, Guard, NotOfferedError, Refusal

MOST = 48  # connections at once; a page has two
IDLE_S = 20.0  # within which the next request must be there, with all of its body
SEND_S = 10.0  # within which an answer must be taken

_BUSY = (
    b"HTTP/1.1 503 Service Unavailable\r\nContent-Type: text/plain; charset=utf-8\r\nConnection: close\r\n"
    b"Retry-After: 5\r\n\r\ntoo many viewers; close a page and try again\n"
)
JSON, TEXT = "application/json; charset=utf-8", "text/plain; charset=utf-8"


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


# By method and path: each gets the handler, the query and the body.
Answers = Mapping[tuple[str, str], Callable[[Any, dict[str, str], bytes], None]]


class GuardedServer(BoundedServer):
    """Files by their path, with their kind, and who may see what."""

    guard: Guard
    files: dict[str, tuple[bytes, str]]


class RequestHandler(BaseHTTPRequestHandler):
    """One connection. A further class has its `answers`."""

    answers: ClassVar[Answers] = {}
    server: GuardedServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = f"ledpi/{__version__}", ""
    default_request_version = "HTTP/1.1"  # of what cannot be read: it gets a whole answer
    disable_nagle_algorithm = True

    def setup(self) -> None:
        """Reads in a hurry."""
        super().setup()
        self.came_ns = 0
        self._hurried = Hurried(self.connection)
        self.rfile = io.BufferedReader(self._hurried)

    def handle_one_request(self) -> None:
        """Within the time that one may take."""
        self._hurried.hurry()
        super().handle_one_request()

    def do_GET(self) -> None:
        """A resource, or an answer about how it is."""
        self._handle("GET")

    def do_POST(self) -> None:
        """Serves what changes something."""
        self._handle("POST")

    def _handle(self, method: str) -> None:
        self.came_ns = time.monotonic_ns()
        headers = {name.lower(): value for name, value in self.headers.items()}
        url, refusal = self._judge(headers)
        if refusal is not None:
            self._refuse(refusal)
            return
        if url.path.startswith("/api/"):
            self.server.trust(self.connection)
        body = self.rfile.read(int(headers.get("content-length", "0")))
        if method == "GET" and url.path in self.server.files:
            content, kind = self.server.files[url.path]
            self.send_content(200, kind, content)
            return
        answer = self.answers.get((method, url.path))
        if answer is None:
            known = {path for _, path in self.answers} | self.server.files.keys()
            status = 405 if url.path in known else 404
            self._refuse(Refusal(status=status, says="no such page" if status == 404 else "asked the wrong way"))
            return
        try:
            answer(self, {key: values[-1] for key, values in parse_qs(url.query).items()}, body)
        except LedpiError as error:
            self._refuse(Refusal(status=_status(error), says=str(error)), close=False)
        except ValueError as error:
            self._refuse(Refusal(status=400, says=str(error)))

    def _judge(self, headers: Mapping[str, str]) -> tuple[SplitResult, Refusal | None]:
        """Returns what is asked for, and why it is not answered; None if it is."""
        try:
            url = urlsplit(self.path)
        except ValueError:  # a bracket that is not closed, say
            return urlsplit("/"), Refusal(status=400, says="what is asked for must be a path, as /api/state")
        return url, self.server.guard.refuse(url.path, headers)

    # ---- Bytes

    def _refuse(self, refusal: Refusal, *, close: bool = True) -> None:
        """Refuses it. What a body may hold is not read: the connection is closed."""
        self.close_connection = self.close_connection or close
        self.send_json({"error": refusal.says}, refusal.status)

    def send_json(self, values: Any, status: int = 200) -> None:
        """Sends a whole answer."""
        self.send_content(status, JSON, encoded(values))

    def send_content(self, status: int, kind: str, content: bytes) -> None:
        """Sends a whole answer of any kind."""
        self.begin_answer(status, kind, len(content))
        self.wfile.write(content)

    def begin_answer(self, status: int, kind: str, size: int) -> None:
        """Sends the head of an answer, whose content follows."""
        self.send_response(status)
        for name, value in HEADERS.items():
            self.send_header(name, value)
        if status != 204:
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(size))
        if status == 401:
            self.send_header("WWW-Authenticate", 'Bearer realm="ledpi"')
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()

    def handle_expect_100(self) -> bool:
        """Before it sends a body, a client may ask whether it will be taken."""
        headers = {name.lower(): value for name, value in self.headers.items()}
        _, refusal = self._judge(headers)
        if refusal is None:
            return super().handle_expect_100()
        self._refuse(refusal)
        return False

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Sends what http.server itself refuses: in our form, and with nothing of the request in it."""
        self.close_connection = True
        says = self.responses[code][1] if code in self.responses else "refused"
        self.send_json({"error": says}, int(code))

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are not logged: there are twenty a second."""


def _status(error: LedpiError) -> int:
    if isinstance(error, NotOfferedError):
        return 403
    return 503 if isinstance(error, TapError | TransientError) else 400


def encoded(values: Any) -> bytes:
    """Returns them as JSON."""
    return json.dumps(values, separators=(",", ":")).encode()
