"""The page's HTTP: a fixed table of resources, and a few questions that the page asks again and again.

The standard library's threading server is enough, as the page needs no more than answers to short questions: it asks
for the next picture when it has drawn the last (`/api/frame` waits until there is one). So one picture at most is on
its way to a viewer, and none queues up in a slow line's buffers, as in an endless MJPEG or a WebSocket; what is drawn
over a picture comes in the same answer, and fits; and the token goes in a header, which an <img> cannot send.
"""

from __future__ import annotations

import json
import logging
import struct
import threading
import time
from base64 import b64encode
from collections.abc import Callable, Iterator
from importlib import resources
from typing import Any, ClassVar

from ledpi.core.errors import TapError
from ledpi.page.board import BoardWatch, board_of
from ledpi.page.connections import TEXT, Answers, GuardedServer, RequestHandler, encoded
from ledpi.page.guard import Guard
from ledpi.page.hub import ANSWER_S, SAVED_S, Hub
from ledpi.page.metrics import KIND as METRICS
from ledpi.page.pictures import KINDS
from ledpi.page.settings import Settings

WAIT_S = 2.0  # that a question waits for news
_SCRIPTS = (
    *("main.js", "server.js", "drawing.js", "picture.js", "why_not.js", "light.js"),
    *("table.js", "map.js", "health.js", "actions.js", "takes.js", "lens.js", "settings.js"),
)
FILES = {
    "/": ("index.html", "text/html; charset=utf-8"),
    "/view.css": ("view.css", "text/css; charset=utf-8"),
    **{f"/{name}": (name, "text/javascript; charset=utf-8") for name in _SCRIPTS},
}
RECORD_S = 600.0  # at most, if nobody stops it

_log = logging.getLogger("ledpi.view")


class ViewServer(GuardedServer):
    """Serves one hub."""

    def __init__(self, address: tuple[str, int], guard: Guard, hub: Hub, settings: Settings) -> None:
        """Raises OSError where the address cannot be had."""
        self.guard, self.hub, self.takes, self.settings = guard, hub, Takes(hub), settings
        self.board: BoardWatch | None = None  # one for all viewers, as there is one camera
        folder = resources.files("ledpi.page") / "static"
        # Read once: no request reaches the file system.
        self.files = {path: ((folder / name).read_bytes(), kind) for path, (name, kind) in FILES.items()}
        super().__init__(address, Handler)


def _json(values: Callable[[ViewServer, dict[str, str]], Any]) -> Callable[[Handler, dict[str, str], bytes], None]:
    """An answer of these values alone."""
    return lambda handler, query, body: handler.send_json(values(handler.server, query))


def _content(kind: str, make: Callable[[ViewServer], bytes]) -> Callable[[Handler, dict[str, str], bytes], None]:
    return lambda handler, query, body: handler.send_content(200, kind, make(handler.server))


def _place_of(answer: dict[str, Any] | None) -> dict[str, Any]:
    """The recording that a command has made."""
    if answer is None:
        raise TapError("the daemon does not answer")
    return {"path": answer.get("path")}


class Handler(RequestHandler):
    """The answers of one connection."""

    server: ViewServer

    def answer_frame(self, query: dict[str, str], body: bytes) -> None:
        """The next picture: length of the JSON (4 bytes, big-endian), JSON, JPEG. 204 if there is none for a while."""
        kind = query.get("kind", "plain")
        if kind not in KINDS:
            raise ValueError(f"kind must be one of {', '.join(KINDS)}")
        shown = self.server.hub.pictures.wait(kind, _whole(query, "after"), WAIT_S)
        if shown is None:
            self.send_content(204, TEXT, b"")
            return
        told, jpeg = shown.as_kind(kind)
        head = encoded(told | {"came_ns": self.came_ns, "sent_ns": time.monotonic_ns()})
        self.send_content(200, "application/octet-stream", struct.pack(">I", len(head)) + head + jpeg)

    def answer_png(self, query: dict[str, str], body: bytes) -> None:
        """The newest picture as it is, for who wants to keep it."""
        shown = self.server.hub.pictures.newest()
        if shown is None:
            raise TapError("there is no picture yet")
        self.send_content(200, "image/png", shown.png())

    def answer_nothing(self, query: dict[str, str], body: bytes) -> None:
        """Browsers ask for an icon."""
        self.send_content(204, TEXT, b"")

    def answer_edit(self, query: dict[str, str], body: bytes) -> None:
        """Changes a key, or brings back the older file."""
        try:
            request = json.loads(body)
        except (ValueError, RecursionError):
            request = None
        if not isinstance(request, dict):
            raise ValueError("a change must be a JSON object")
        self.send_json({"says": self.server.settings.change(request)})

    def answer_restore(self, query: dict[str, str], body: bytes) -> None:
        """Puts one back."""
        request = {"do": "restore", "archive": b64encode(body).decode()}
        self.send_json({"says": self.server.settings.change(request)})

    def answer_take(self, query: dict[str, str], body: bytes) -> None:
        """A take as one tar file, passed on piece by piece. Where it breaks off, so does the connection."""
        size, pieces = self.server.takes.tar(query.get("name", ""))
        self.begin_answer(200, "application/x-tar", size)
        try:
            for piece in pieces:
                self.wfile.write(piece)
        except TapError as error:
            self.close_connection = True
            _log.warning("a download broke off: %s", error)

    def answer_board(self, query: dict[str, str], body: bytes) -> None:
        """Answers how far the calibration is; null before one was begun."""
        watch = self.server.board
        self.send_json(None if watch is None else watch.told())

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
        self.send_content(200, "text/yaml; charset=utf-8", text.encode())

    answers: ClassVar[Answers] = {
        ("GET", "/favicon.ico"): answer_nothing,
        ("GET", "/metrics"): _content(METRICS, lambda view: view.hub.metrics().encode()),
        ("GET", "/api/frame"): answer_frame,
        ("GET", "/api/frame.png"): answer_png,
        ("GET", "/api/state"): _json(lambda view, query: view.hub.state(_whole(query, "after"), WAIT_S)),
        ("GET", "/api/history"): _json(lambda view, query: view.hub.history()),
        ("GET", "/api/config"): _json(lambda view, query: view.settings.told()),
        ("GET", "/api/takes"): _json(lambda view, query: view.takes.listed()),
        ("GET", "/api/take.tar"): answer_take,
        ("GET", "/api/board"): answer_board,
        ("GET", "/api/camera.yaml"): answer_lens,
        ("GET", "/api/backup"): _content("application/zip", lambda view: view.settings.backup()),
        ("POST", "/api/edit"): answer_edit,
        ("POST", "/api/restore"): answer_restore,
        ("POST", "/api/reload"): _json(lambda view, query: view.settings.reload()),
        ("POST", "/api/board/start"): answer_board_start,
        ("POST", "/api/board/stop"): answer_board_stop,
        ("POST", "/api/save"): _json(lambda view, query: _place_of(view.hub.ask("save", SAVED_S))),
        ("POST", "/api/take_delete"): _json(lambda view, query: view.takes.delete(query.get("name", ""))),
        ("POST", "/api/record"): _json(lambda view, query: _place_of(view.hub.record(RECORD_S))),
        ("POST", "/api/record_stop"): _json(lambda view, query: _place_of(view.hub.record_stop())),
    }


def _whole(query: dict[str, str], key: str) -> int:
    text = query.get(key, "-1")
    if not text.isascii() or not text.removeprefix("-").isdigit() or len(text) > 18:
        raise ValueError(f"{key} must be a whole number")
    return int(text)


class Takes:
    """Asks through a hub. From any thread; all raise TapError."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._reading = threading.Lock()  # the daemon reads for one client at a time

    def listed(self) -> list[dict[str, Any]]:
        """The newest first."""
        return list(self._asked("takes").get("takes", []))

    def delete(self, name: str) -> dict[str, Any]:
        """For good; a long one has thousands of files. Nothing to say."""
        self._asked("take_delete", SAVED_S, name=name)
        return {}

    def tar(self, name: str) -> tuple[int, Iterator[bytes]]:
        """Returns how many bytes its tar file has, and these, piece by piece."""
        first = self._piece(name, 0)
        return int(first["size"]), self._pieces(name, first)

    def _pieces(self, name: str, piece: dict[str, Any]) -> Iterator[bytes]:
        size, sent = piece["size"], 0
        while sent < size:
            if piece["size"] != size or not piece.get("raw"):
                raise TapError(f"{name}: has changed meanwhile")
            yield piece["raw"]
            sent += len(piece["raw"])
            if sent < size:
                piece = self._piece(name, sent)

    def _piece(self, name: str, offset: int) -> dict[str, Any]:
        with self._reading:
            return self._asked("take", name=name, offset=offset)

    def _asked(self, do: str, within_s: float = ANSWER_S, **values: Any) -> dict[str, Any]:
        answer = self._hub.ask(do, within_s, **values)
        if answer is None:
            raise TapError("the daemon does not answer")
        return answer
