"""A recording → WPILib's data log (.wpilog), for AdvantageScope: poses as the NetworkTables bridge publishes them.

The format is WPILib's, version 1.0 (wpiutil's doc/datalog.adoc): records of an entry's number, a time and bytes; entry
0 begins the others. Times are µs of the recording's own clock.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from ledpi.core.errors import RecordingError
from ledpi.core.files import not_written, nothing_left
from ledpi.daemon.tap.messages import Shown
from ledpi.daemon.tap.messages import decoded as decoded_line
from ledpi.links.bags.replay import Replay, Warn
from ledpi.links.wpilib_values import SCHEMAS, TYPES, frame_values

HEADER = b"WPILOG\x00\x01" + bytes(4)  # version 1.0, little endian; nothing more about the whole
TABLE = "NT:/ledpi"  # as a robot's log names what the bridge has published
PACKED = {"DoubleArray": "d", "IntegerArray": "q"}


class WpilogWriter:
    """Writes one log."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._entries: dict[str, int] = {}  # their numbers, by name
        file.write(HEADER)

    def add(self, name: str, kind: str, value: bytes, at_us: int, metadata: str = "") -> None:
        """Adds a value of the entry of that name, which begins with its first."""
        number = self._entries.get(name)
        if number is None:
            number = self._entries[name] = len(self._entries) + 1
            texts = b"".join(_text(text) for text in (name, kind, metadata))
            self._file.write(_record(0, at_us, struct.pack("<BI", 0, number) + texts))
        self._file.write(_record(number, at_us, value))


def export_wpilog(replay: Replay, out: Path, warn: Warn) -> Iterator[None]:
    """Writes it, and yields after each frame. Raises LedpiError."""
    recording = replay.recording
    with nothing_left(out), _new_file(out) as file:
        log = WpilogWriter(file)
        for count, (_, frame, decoded) in enumerate(replay.frames(warn)):
            shown = Shown(decoded.seq, frame, decoded, done_ns=0, rows=recording.camera.height)
            values, at_us = list(frame_values(decoded_line(shown))), frame.row0_readout_ns // 1000
            if count == 0:
                _begin(log, at_us, recording.wall_clock_offset_ns)
            for name, kind, value, exposed_ns in values:
                data = value if isinstance(value, bytes) else struct.pack(f"<{len(value)}{PACKED[kind]}", *value)
                log.add(f"{TABLE}/{name}", TYPES[kind], data, exposed_ns // 1000)
            yield


@contextmanager
def _new_file(path: Path) -> Iterator[BinaryIO]:
    try:
        with path.open("xb") as file:
            yield file
    except FileExistsError:
        raise RecordingError(f"{path}: is there already; give a new name") from None
    except OSError as error:
        raise not_written(path, error, RecordingError) from None


def _begin(log: WpilogWriter, at_us: int, offset_ns: int | None) -> None:
    """Notes what the values' bytes mean, and the time of day, where it is known, as WPILib's DataLogManager does."""
    for struct_name, schema in SCHEMAS.items():
        log.add(f"NT:/.schema/struct:{struct_name}", "structschema", schema.encode(), at_us)
    if offset_ns is not None:
        now = struct.pack("<q", at_us + offset_ns // 1000)
        log.add("systemTime", "int64", now, at_us, '{"source":"ledpi","format":"time_t_us"}')


def _record(number: int, at_us: int, payload: bytes) -> bytes:
    """Each number in as few bytes as it takes; the first byte says in how many. No time is before the clock's zero,
    where a recording may begin: its first rows were exposed before that.
    """
    parts = [_shortest(value) for value in (number, len(payload), max(at_us, 0))]
    sizes = sum(len(part) - 1 << shift for part, shift in zip(parts, (0, 2, 4), strict=True))
    return bytes([sizes]) + b"".join(parts) + payload


def _shortest(value: int) -> bytes:
    return value.to_bytes(max(1, (value.bit_length() + 7) // 8), "little")


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data)) + data
