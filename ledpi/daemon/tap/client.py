"""Reads the tap of a running daemon.

with connect() as tap:
    for line in tap.lines():
        if line["type"] == "decoded": ...
"""

from __future__ import annotations

import itertools
import json
import os
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from ledpi.core.errors import TapAgainError, TapError, raising
from ledpi.daemon.tap.places import AUTO, GROUP, to_look
from ledpi.daemon.tap.protocol import VERSION, read_line

ANSWER_S = 5.0  # within which a daemon answers; a picture takes until the next frame
HELLO_S = 2.0
RETRY_S = 0.2  # between two looks for a daemon that is gone
MAX_LINE_BYTES = 1 << 24
MAX_RAW_BYTES = 1 << 26
_CHUNK = 1 << 18


class _LostError(Exception):
    """The daemon has gone, or what it sends is no tap's."""


def connect(socket_path: str | Path = AUTO) -> Client:
    """To the daemon that listens there; with `auto`, to the first that answers.

    Raises TapError where none does, saying where it was looked for.
    """
    return Client(_places(socket_path))


class Client:
    """One connection, which `lines` opens again when the daemon is started anew.

    One thread reads; any may `send`. `hello`: the daemon's first line. `path`: where it listens.
    """

    def __init__(self, places: list[Path]) -> None:
        """Raises TapError where none of `places` answers."""
        self._places = places
        self._ids = itertools.count(1)
        self._sending = threading.Lock()
        self._closed = False
        self.path, self._socket, self.hello, self._buffer = _open(places)

    def lines(self, *, reconnect: bool = False, tick_s: float | None = None) -> Iterator[dict[str, Any]]:
        """Each line of the daemon, its hello first, until the daemon ends or `close`.

        Raw bytes that follow a line are in it: of a picture as `pixels`, uint8 (height, width), read-only, of others as
        `raw`. With `reconnect` a lost
        daemon is {"type": "lost"}, once, and then its hello when it is back. With `tick_s` there is a
        {"type": "tick"} whenever so long nothing came, for callers that have something else to do.
        """
        yield self.hello
        while not self._closed:
            try:
                line = self._read(None if tick_s is None else time.monotonic() + tick_s)
            except _LostError:
                if not reconnect or self._closed:
                    return
                yield {"type": "lost"}
                yield from self._come_back(tick_s)
                continue
            yield {"type": "tick"} if line is None else line

    def send(self, do: str, **values: Any) -> int:
        """Asks; returns the answer's `id`. Raises TapError where the daemon is gone."""
        request_id = next(self._ids)
        line = json.dumps({"do": do, "id": request_id, **values}) + "\n"
        try:
            with self._sending:
                self._socket.sendall(line.encode())
        except OSError as error:
            raise TapError(f"{self.path}: the daemon is gone ({error.strerror or error})") from None
        return request_id

    def ask(self, do: str, timeout_s: float = ANSWER_S, **values: Any) -> dict[str, Any]:
        """Asks, and waits for the answer; other lines are passed over. Not while `lines` is read.

        Raises TapError where the daemon is gone, refuses, or does not answer in time.
        """
        request_id, until_s = self.send(do, **values), time.monotonic() + timeout_s
        with raising(f"{self.path}", TapError, _LostError):
            while (line := self._read(until_s)) is not None:
                if line["type"] == "error" and line.get("id") in (request_id, None):
                    kind = TapAgainError if line.get("again") is True else TapError
                    raise kind(f"{self.path}: {line.get('error')}")
                if line.get("id") == request_id:
                    return line
                if time.monotonic() > until_s:
                    break
        raise TapError(f"{self.path}: no answer within {timeout_s:g} s; does its camera deliver?")

    def picture(self, *extras: str, timeout_s: float = ANSWER_S) -> dict[str, Any]:
        """The next decoded frame: the answer, and `pixels`, uint8 (height, width); `extras`: rejected, evidence."""
        answer = self.ask("picture", timeout_s, **{"with": list(extras)})
        if "pixels" not in answer:
            raise TapError(f"{self.path}: sent a picture without pixels")
        return answer

    def close(self) -> None:
        """Ends `lines`, also in another thread. Safe to call twice."""
        self._closed = True
        with suppress(OSError):  # it is gone already
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _come_back(self, tick_s: float | None) -> Iterator[dict[str, Any]]:
        """Until a daemon answers again, or `close`."""
        self._socket.close()
        ticked_s = time.monotonic()
        while not self._closed:
            try:
                path, connection, hello, buffer = _open(self._places)
            except TapError:
                time.sleep(RETRY_S)
                if tick_s is not None and time.monotonic() - ticked_s >= tick_s:
                    ticked_s = time.monotonic()
                    yield {"type": "tick"}
                continue
            with self._sending:
                self.path, self._socket, self.hello, self._buffer = path, connection, hello, buffer
            if self._closed:  # meanwhile
                connection.close()
                return
            yield hello
            return

    def _read(self, until_s: float | None) -> dict[str, Any] | None:
        line = self._buffer.line(until_s)
        if line is not None and line["type"] == "hello":  # after a reload
            self.hello = line
        return line


class _Buffer:
    """Bytes that have come of a connection, and are not yet a whole line."""

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._data = bytearray()

    def line(self, until_s: float | None) -> dict[str, Any] | None:
        """The next, with the raw bytes that follow it; None when the time (CLOCK_MONOTONIC) is over. Raises _Lost."""
        while (end := self._data.find(b"\n")) < 0:
            if len(self._data) > MAX_LINE_BYTES:
                raise _LostError("sends no lines: that is no tap")
            if not self._fill(until_s):
                return None
        try:
            values = read_line(bytes(self._data[:end]))
            size = int(values.get("bytes", 0))
        except (ValueError, TypeError, RecursionError):
            raise _LostError("sends what is no line of a tap") from None
        if not 0 <= size <= MAX_RAW_BYTES:
            raise _LostError(f"announces {size} bytes; that is no tap")
        while len(self._data) < end + 1 + size:
            if not self._fill(until_s):
                return None  # the line stays, for its bytes to come
        raw = bytes(self._data[end + 1 : end + 1 + size])
        del self._data[: end + 1 + size]
        if size and values["type"] == "picture":
            values["pixels"] = _pixels(raw, values)
        elif size:
            values["raw"] = raw
        return values

    def _fill(self, until_s: float | None) -> bool:
        """Returns whether something came before the time was over. Raises _Lost at the end."""
        left_s = None if until_s is None else max(until_s - time.monotonic(), 1e-4)
        try:
            self._socket.settimeout(left_s)
            data = self._socket.recv(_CHUNK)
        except TimeoutError:
            return False
        except OSError as error:
            raise _LostError(f"the daemon is gone ({error.strerror or error})") from None
        if not data:
            raise _LostError("the daemon has ended")
        self._data += data
        return True


def _pixels(raw: bytes, values: dict[str, Any]) -> np.ndarray[Any, np.dtype[np.uint8]]:
    try:
        return np.frombuffer(raw, np.uint8).reshape(int(values["height"]), int(values["width"]))
    except (KeyError, ValueError, TypeError):
        raise _LostError("sends bytes that are no picture of the size it says") from None


def _places(socket_path: str | Path) -> list[Path]:
    return to_look() if str(socket_path) == AUTO else [Path(socket_path)]


def _open(places: list[Path]) -> tuple[Path, socket.socket, dict[str, Any], _Buffer]:
    """The first that says hello. Raises TapError, with what each of the others said."""
    said = []
    for place in places:
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC)
        try:
            connection.settimeout(HELLO_S)
            connection.connect(os.fspath(place))
            buffer = _Buffer(connection)
            hello = buffer.line(time.monotonic() + HELLO_S)
            _check(hello)
        except (OSError, _LostError, TapError) as error:
            connection.close()
            hint = f" (are you in the group {GROUP}?)" if isinstance(error, PermissionError) else ""
            said.append(f"{place}: {(error.strerror if isinstance(error, OSError) else None) or error}{hint}")
            continue
        assert hello is not None
        return place, connection, hello, buffer
    raise TapError(f"no running daemon answers ({'; '.join(said)}); start `ledpi run`, or the service")


def _check(hello: dict[str, Any] | None) -> None:
    if hello is None:
        raise TapError("does not say hello")
    if hello["type"] == "error":
        raise TapError(str(hello.get("error")))
    if hello["type"] != "hello" or hello.get("tap") != VERSION:
        raise TapError(f"speaks version {hello.get('tap')} of the tap; this is {VERSION}: are both of one ledpi?")
