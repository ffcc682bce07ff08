"""A small daemon's end of the tap, which shows what a test wants: lines and pictures, as docs/tap.md describes them."""

from __future__ import annotations

import json
import socket
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from ledpi.core.records import Pixels

HELLO: dict[str, Any] = {
    "type": "hello",
    "tap": 1,
    "version": "0.0.0",
    "pid": 1,
    "camera": {
        "width": 64,
        "height": 48,
        "row_time_us": 33.67,
        "exposure_us": 9966.0,
        "frame_length_rows": 504,
        "fx": 64.0,
        "fy": 64.0,
        "cx": 32.0,
        "cy": 24.0,
        "distortion": [0.0] * 5,
        "transfer": "srgb",
        "source": "made up",
    },
    "panels": {"dictionary": "DICT_4X4_50", "side_m": 0.16, "black_hz": 1250.0, "white_hz": 2450.0, "duty": 0.5},
    "map": None,
    "may": ["save", "record"],
    "dropped": 0,
}
HEALTH: dict[str, Any] = {
    "type": "health",
    "state": "running",
    "no_fix": "no_map",
    "uptime_s": 5,
    "frames_per_s": 30.0,
    "decoded": 100,
    "dropped_frames": 0,
    "rejected": {},
    "latency_ms": {"median": 3.0, "worst": 6.0},
    "temperature_c": 50.0,
    "throttled": None,
    "wire": {"packets": 1, "dropped": 0, "connected": True},
    "faults": [],
    "config_path": None,
}
PANEL: dict[str, Any] = {
    "id": 7,
    "corners_px": [[10.0, 10.0], [30.0, 10.0], [30.0, 30.0], [10.0, 30.0]],
    "margin": 40.0,
    "frames_used": 3,
    "position_m": [0.0, 0.0, 2.0],
    "quaternion_wxyz": [0.0, 1.0, 0.0, 0.0],
    "covariance": None,
    "reprojection_px": 0.1,
    "alternate": None,
}
TAKE, TAKE_BYTES, PIECE_BYTES = "20261124T101502Z-asked", 60_000_123, 1 << 18
# Of a camera of 640 × 480.
LARGE = {"camera": HELLO["camera"] | {"width": 640, "height": 480, "fx": 640.0, "fy": 640.0, "cx": 320.0, "cy": 240.0}}
CONFIG = {"panels.side_m": 0.16, "view.token": "abcdefghijkl"}


def decoded(seq: int, **changes: Any) -> dict[str, Any]:
    """A line of one frame, exposed now."""
    now_ns = time.monotonic_ns()
    return {
        "type": "decoded",
        "recording": "",
        "seq": seq,
        "sensor_timestamp_ns": now_ns,
        "decode_ms": 2.0,
        "markers": [PANEL | {"exposed_ns": now_ns}],
        "robot": None,
        "rejected": {},
        "exposed_ns": now_ns,
        "decoded_ns": now_ns,
        "exposure_us": 9966.0,
        "analogue_gain": 2.0,
        "dropped": 0,
    } | changes


class MadeUpDaemon:
    """Listens at `path`; a frame each 20 ms, each with a picture that differs from the last."""

    def __init__(
        self,
        path: Path,
        *,
        hello: dict[str, Any] | None = None,
        picture: dict[str, Any] | None = None,
        numbered: bool = False,
        frame_s: float = 0.02,
        first: int = 1,
    ) -> None:
        """`numbered`: the panel's x is the frame's number, in mm, from `first` on. `frame_s`: from frame to frame."""
        self.numbered, self.frame_s, self.last_seq = numbered, frame_s, first - 1
        self.hello, self.extra = HELLO | (hello or {}), picture or {}
        self.disk_is_full = True
        self.take_breaks_at = TAKE_BYTES
        self.frame: dict[str, Any] = {}
        self.robot_state: dict[str, Any] | None = None  # beside each frame, of the same time
        self.exposed_ns: dict[int, int] = {}  # by number
        self.requests: list[dict[str, Any]] = []
        self._clients: list[socket.socket] = []
        self._sending = threading.Lock()
        self._wanted: list[tuple[socket.socket, dict[str, Any]]] = []
        self._recording: tuple[socket.socket, dict[str, Any]] | None = None
        self._closing = threading.Event()
        path.unlink(missing_ok=True)
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(str(path))
        self._listener.listen()
        self._threads = [threading.Thread(target=loop, daemon=True) for loop in (self._accept, self._show)]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Ends as a killed daemon does: its socket's file stays."""
        self._closing.set()
        for end in (self._listener, *self._clients):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()
        for thread in self._threads:
            thread.join(2.0)
        for client in self._clients:  # one that was let in meanwhile
            client.close()

    def asked(self, do: str) -> list[dict[str, Any]]:
        """The requests of a kind so far."""
        return [request for request in self.requests if request["do"] == do]

    def end_recording(self) -> None:
        """Now it is answered, if there is one."""
        if self._recording is not None:
            (client, request), self._recording = self._recording, None
            self._send(client, {"type": "done", "id": request["id"], "path": "/var/lib/ledpi/take"})

    def _accept(self) -> None:
        while not self._closing.is_set():
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            self._send(client, self.hello)
            self._send(client, HEALTH)
            self._clients.append(client)
            threading.Thread(target=self._listen, args=(client,), daemon=True).start()

    def _listen(self, client: socket.socket) -> None:
        with suppress(OSError, ValueError), client.makefile("rb") as lines:
            for line in lines:
                request = json.loads(line)
                self.requests.append(request)
                if request["do"] == "picture":
                    self._wanted.append((client, request))
                elif request["do"] == "config":
                    origins = dict.fromkeys(CONFIG, "default")
                    self._send(client, {"type": "config", "id": request["id"], "values": CONFIG, "from": origins})
                elif request["do"] == "takes":
                    takes = [{"name": TAKE, "frames": 9, "written": False}]
                    self._send(client, {"type": "done", "id": request["id"], "takes": takes})
                elif request["do"] == "take":
                    self._send_piece(client, request)
                elif request["do"] == "record" and self.disk_is_full:
                    self._send(client, {"type": "error", "id": request["id"], "error": "the disk is full"})
                elif request["do"] == "record":
                    self._recording = (client, request)
                else:
                    self.end_recording()
                    self._send(client, {"type": "done", "id": request["id"], "path": "/var/lib/ledpi/take"})

    def _show(self) -> None:
        while not self._closing.wait(self.frame_s):
            self.last_seq = seq = self.last_seq + 1
            line = decoded(seq, **self.frame)
            self.exposed_ns[seq] = line["exposed_ns"]
            if self.numbered:
                line["markers"][0]["position_m"] = [seq / 1000, 0.0, 2.0]
            wanted, self._wanted = self._wanted, []
            for client in list(self._clients):
                self._send(client, line)
                if self.robot_state is not None:
                    now = {"type": "robot_state", "t_ns": line["exposed_ns"]}
                    self._send(client, now | {"panel_ns": line["exposed_ns"] - 2_400_000_000} | self.robot_state)
            for client, request in wanted:
                pixels = self.picture(seq)
                head = {"type": "picture", "id": request["id"], "format": "gray8"}
                head |= {
                    "height": pixels.shape[0],
                    "width": pixels.shape[1],
                    "bytes": pixels.size,
                    "decoded": line,
                    "pixels_max_share": 0.0,
                }
                self._send(
                    client, head | {key: self.extra.get(key, []) for key in _EXTRAS if asks(request, key)}, pixels
                )
            if seq % 50 == 0:
                for client in list(self._clients):
                    self._send(client, HEALTH)

    def picture(self, seq: int) -> Pixels:
        """Stripes that move, as large as `hello` says: (48, 64) uint8."""
        height, width = (self.hello["camera"][key] for key in ("height", "width"))
        rows = (np.arange(height) + seq) * 10 % 256
        return np.repeat(rows.astype(np.uint8)[:, None], width, axis=1)

    def _send_piece(self, client: socket.socket, request: dict[str, Any]) -> None:
        """Sends one of a take of TAKE_BYTES; from `take_breaks_at` on there is none."""
        offset = request["offset"]
        if request["name"] != TAKE or offset >= self.take_breaks_at:
            self._send(client, {"type": "error", "id": request["id"], "error": f"take: no {request['name']}"})
            return
        piece = np.full(min(PIECE_BYTES, TAKE_BYTES - offset), offset // PIECE_BYTES % 251, np.uint8)
        head = {"type": "done", "id": request["id"], "size": TAKE_BYTES, "bytes": piece.size}
        self._send(client, head, piece)

    def _send(self, client: socket.socket, line: dict[str, Any], pixels: Pixels | None = None) -> None:
        data = json.dumps(line).encode() + b"\n" + (b"" if pixels is None else pixels.tobytes())
        with suppress(OSError), self._sending:
            client.sendall(data)


_EXTRAS = {"rejected": "rejected", "looks": "evidence"}  # a line's key, and what a request calls it


def asks(request: dict[str, Any], key: str) -> bool:
    """Tells whether a request for a picture wants what stands at a key."""
    return _EXTRAS[key] in request.get("with", [])
