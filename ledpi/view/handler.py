"""Requests to the page's server: who may ask, for which resource, and the bytes of an answer."""

from __future__ import annotations

import io
import json
import time
from collections.abc import Callable, Mapping
from http.server import BaseHTTPRequestHandler
from typing import Any, ClassVar
from urllib.parse import SplitResult, parse_qs, urlsplit

from ledpi import __version__
from ledpi.core.errors import LedpiError, TapError, TransientError
from ledpi.view.connections import BoundedServer, Hurried
from ledpi.view.guard import HEADERS, Guard, NotOfferedError, Refusal

JSON, TEXT = "application/json; charset=utf-8", "text/plain; charset=utf-8"

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
