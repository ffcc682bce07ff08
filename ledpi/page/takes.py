"""The daemon's recordings, for the page: each answer is the daemon's own, as this process reads no such file."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

from ledpi.core.errors import TapError
from ledpi.page.hub import ANSWER_S, SAVED_S, Hub


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
