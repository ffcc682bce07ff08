"""The page's HTTP: a fixed table of resources, and a few questions that the page asks again and again.

The standard library's threading server is enough, as the page needs no more than answers to short questions: it asks
for the next picture when it has drawn the last (`/api/frame` waits until there is one). So one picture at most is on
its way to a viewer, and none queues up in a slow line's buffers, as in an endless MJPEG or a WebSocket; what is drawn
over a picture comes in the same answer, and fits; and the token goes in a header, which an <img> cannot send.
"""

from __future__ import annotations

import io
import json
import logging
import struct
import time
from collections.abc import Callable, Mapping
from http.server import BaseHTTPRequestHandler
from importlib import resources
from typing import Any
from urllib.parse import SplitResult, parse_qs, urlsplit

from ledpi import __version__
from ledpi.core.errors import TapError
from ledpi.view.board import BoardWatch, board_of
from ledpi.view.connections import BoundedServer, Hurried
from ledpi.view.guard import HEADERS, Guard, Refusal
from ledpi.view.hub import SAVED_S, Hub
from ledpi.view.metrics import KIND as METRICS
from ledpi.view.metrics import metrics
from ledpi.view.pictures import KINDS
from ledpi.view.takes import Takes

WAIT_S = 2.0  # that a question waits for news
JSON, TEXT = "application/json; charset=utf-8", "text/plain; charset=utf-8"
_SCRIPTS = (
    *("main.js", "server.js", "drawing.js", "picture.js", "why_not.js", "light.js"),
    *("table.js", "map.js", "health.js", "actions.js", "takes.js", "lens.js"),
)
_FILES = {
    "/": ("index.html", "text/html; charset=utf-8"),
    "/view.css": ("view.css", "text/css; charset=utf-8"),
    **{f"/{name}": (name, "text/javascript; charset=utf-8") for name in _SCRIPTS},
}
RECORD_S = 600.0  # at most, if nobody stops it

_log = logging.getLogger("ledpi.view")


class ViewServer(BoundedServer):
    """Serves one hub."""

    def __init__(self, address: tuple[str, int], guard: Guard, hub: Hub) -> None:
        """Raises OSError where the address cannot be had."""
        self.guard, self.hub, self.takes = guard, hub, Takes(hub)
        self.board: BoardWatch | None = None  # one for all viewers, as there is one camera
        folder = resources.files("ledpi.view") / "static"
        # Read once: no request reaches the file system.
        self.files = {path: ((folder / name).read_bytes(), kind) for path, (name, kind) in _FILES.items()}
        super().__init__(address, Handler)


class Handler(BaseHTTPRequestHandler):
    """One connection."""

    server: ViewServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = f"ledpi/{__version__}", ""
    default_request_version = "HTTP/1.1"  # of what cannot be read: it gets a whole answer
    disable_nagle_algorithm = True

    def setup(self) -> None:
        """Reads in a hurry."""
        super().setup()
        self._came_ns = 0
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
        self._came_ns = time.monotonic_ns()
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
            self._send(200, kind, content)
            return
        answer = _ANSWERS.get((method, url.path))
        if answer is None:
            known = {path for _, path in _ANSWERS} | _FILES.keys()
            status = 405 if url.path in known else 404
            self._refuse(Refusal(status=status, says="no such page" if status == 404 else "asked the wrong way"))
            return
        try:
            answer(self, {key: values[-1] for key, values in parse_qs(url.query).items()}, body)
        except TapError as error:
            self._refuse(Refusal(status=503, says=str(error)), close=False)
        except ValueError as error:
            self._refuse(Refusal(status=400, says=str(error)))

    def _judge(self, headers: Mapping[str, str]) -> tuple[SplitResult, Refusal | None]:
        """Returns what is asked for, and why it is not answered; None if it is."""
        try:
            url = urlsplit(self.path)
        except ValueError:  # a bracket that is not closed, say
            return urlsplit("/"), Refusal(status=400, says="what is asked for must be a path, as /api/state")
        return url, self.server.guard.refuse(url.path, headers)

    # ---- Answers

    def answer_frame(self, query: dict[str, str], body: bytes) -> None:
        """The next picture: length of the JSON (4 bytes, big-endian), JSON, JPEG. 204 if there is none for a while."""
        kind = query.get("kind", "plain")
        if kind not in KINDS:
            raise ValueError(f"kind must be one of {', '.join(KINDS)}")
        shown = self.server.hub.pictures.wait(kind, _whole(query, "after"), WAIT_S)
        if shown is None:
            self._send(204, TEXT, b"")
            return
        told, jpeg = shown.as_kind(kind)
        head = self._encoded(told | {"came_ns": self._came_ns, "sent_ns": time.monotonic_ns()})
        self._send(200, "application/octet-stream", struct.pack(">I", len(head)) + head + jpeg)

    def answer_png(self, query: dict[str, str], body: bytes) -> None:
        """The newest picture as it is, for who wants to keep it."""
        shown = self.server.hub.pictures.newest()
        if shown is None:
            raise TapError("there is no picture yet")
        self._send(200, "image/png", shown.png())

    def answer_state(self, query: dict[str, str], body: bytes) -> None:
        """Answers how it is, as soon as something has changed."""
        state = self.server.hub.state(_whole(query, "after"), WAIT_S)
        self._send(200, JSON, self._encoded(state))

    def answer_metrics(self, query: dict[str, str], body: bytes) -> None:
        """For Prometheus."""
        self._send(200, METRICS, metrics(self.server.hub.health()).encode())

    def answer_nothing(self, query: dict[str, str], body: bytes) -> None:
        """Browsers ask for an icon."""
        self._send(204, TEXT, b"")

    def answer_history(self, query: dict[str, str], body: bytes) -> None:
        """The last minutes."""
        self._send(200, JSON, self._encoded(self.server.hub.history()))

    def answer_config(self, query: dict[str, str], body: bytes) -> None:
        """The daemon's configuration."""
        self._send(200, JSON, self._encoded(self.server.hub.config()))

    def answer_save(self, query: dict[str, str], body: bytes) -> None:
        """Keeps the last seconds."""
        self._done(self.server.hub.ask("save", SAVED_S))

    def answer_record(self, query: dict[str, str], body: bytes) -> None:
        """Begins a recording."""
        self._done(self.server.hub.record(RECORD_S))

    def answer_record_stop(self, query: dict[str, str], body: bytes) -> None:
        """Ends it."""
        self._done(self.server.hub.record_stop())

    def answer_takes(self, query: dict[str, str], body: bytes) -> None:
        """Answers what the daemon has recorded."""
        self._send(200, JSON, self._encoded(self.server.takes.listed()))

    def answer_take(self, query: dict[str, str], body: bytes) -> None:
        """A take as one tar file, passed on piece by piece. Where it breaks off, so does the connection."""
        size, pieces = self.server.takes.tar(query.get("name", ""))
        self._begin(200, "application/x-tar", size)
        try:
            for piece in pieces:
                self.wfile.write(piece)
        except TapError as error:
            self.close_connection = True
            _log.warning("a download broke off: %s", error)

    def answer_take_delete(self, query: dict[str, str], body: bytes) -> None:
        """Deletes one."""
        self.server.takes.delete(query.get("name", ""))
        self._send(200, JSON, self._encoded({}))

    def answer_board(self, query: dict[str, str], body: bytes) -> None:
        """Answers how far the calibration is; null before one was begun."""
        watch = self.server.board
        self._send(200, JSON, self._encoded(None if watch is None else watch.told()))

    def answer_board_start(self, query: dict[str, str], body: bytes) -> None:
        """Begins anew."""
        board = board_of(query.get("kind", ""), _whole(query, "cols"), _whole(query, "rows"))
        if self.server.board is not None:
            self.server.board.stop()
        self.server.board = BoardWatch(board, self.server.hub.pictures)
        self.answer_board({}, b"")

    def answer_board_stop(self, query: dict[str, str], body: bytes) -> None:
        """Ends it; what was found stays."""
        if self.server.board is not None:
            self.server.board.stop()
        self.answer_board({}, b"")

    def answer_lens(self, query: dict[str, str], body: bytes) -> None:
        """camera.yaml."""
        watch = self.server.board
        text = None if watch is None else watch.camera_yaml()
        if text is None:
            raise TapError("there is no lens yet")
        self._send(200, "text/yaml; charset=utf-8", text.encode())

    def _done(self, answer: dict[str, Any] | None) -> None:
        if answer is None:
            raise TapError("the daemon does not answer")
        self._send(200, JSON, self._encoded({"path": answer.get("path")}))

    # ---- Bytes

    def _encoded(self, values: Any) -> bytes:
        return json.dumps(values, separators=(",", ":")).encode()

    def _refuse(self, refusal: Refusal, *, close: bool = True) -> None:
        """Refuses it. What a body may hold is not read: the connection is closed."""
        self.close_connection = self.close_connection or close
        self._send(refusal.status, JSON, self._encoded({"error": refusal.says}))

    def _send(self, status: int, kind: str, content: bytes) -> None:
        self._begin(status, kind, len(content))
        self.wfile.write(content)

    def _begin(self, status: int, kind: str, size: int) -> None:
        """The head of an answer."""
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
        self._send(int(code), JSON, self._encoded({"error": says}))

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are not logged: there are twenty a second."""


def _whole(query: dict[str, str], key: str) -> int:
    text = query.get(key, "-1")
    if not text.isascii() or not text.removeprefix("-").isdigit() or len(text) > 18:
        raise ValueError(f"{key} must be a whole number")
    return int(text)


_ANSWERS: dict[tuple[str, str], Callable[[Handler, dict[str, str], bytes], None]] = {
    ("GET", "/favicon.ico"): Handler.answer_nothing,
    ("GET", "/metrics"): Handler.answer_metrics,
    ("GET", "/api/frame"): Handler.answer_frame,
    ("GET", "/api/frame.png"): Handler.answer_png,
    ("GET", "/api/state"): Handler.answer_state,
    ("GET", "/api/history"): Handler.answer_history,
    ("GET", "/api/config"): Handler.answer_config,
    ("GET", "/api/takes"): Handler.answer_takes,
    ("GET", "/api/take.tar"): Handler.answer_take,
    ("GET", "/api/board"): Handler.answer_board,
    ("GET", "/api/camera.yaml"): Handler.answer_lens,
    ("POST", "/api/board/start"): Handler.answer_board_start,
    ("POST", "/api/board/stop"): Handler.answer_board_stop,
    ("POST", "/api/save"): Handler.answer_save,
    ("POST", "/api/take_delete"): Handler.answer_take_delete,
    ("POST", "/api/record"): Handler.answer_record,
    ("POST", "/api/record_stop"): Handler.answer_record_stop,
}
