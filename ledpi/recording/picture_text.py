"""Words of a saved picture on its camera and its panels: JSON in a text chunk of its PNG (specification §11.3.3.2)."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator, Mapping
from typing import Any

from ledpi.core.files import parse_json
from ledpi.recording.picture import PNG_SIGNATURE

KEYWORD = b"ledpi"
MAX_BYTES = 1 << 20  # of the text: a map of a thousand panels takes 200 kB
_IHDR_END = 8 + 4 + 4 + 13 + 4  # signature, then the first chunk's length, name, content and checksum


def with_text(png: bytes, values: Mapping[str, Any]) -> bytes:
    """The PNG with these values, as JSON has them, after its header. Pixels stay as they are."""
    body = b"tEXt" + KEYWORD + b"\0" + json.dumps(values).encode("ascii")
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    return png[:_IHDR_END] + chunk + png[_IHDR_END:]


def text_of(data: bytes) -> dict[str, Any] | None:
    """Returns what `with_text` wrote; None where the bytes are no PNG, or say nothing of the kind."""
    for name, content in _chunks(data):
        keyword, _, text = content.partition(b"\0")
        if name == b"tEXt" and keyword == KEYWORD and len(text) <= MAX_BYTES:
            try:
                values = parse_json(text.decode())
            except ValueError:
                return None
            return values if isinstance(values, dict) else None
    return None


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Name and content of each before the pixels."""
    at = len(PNG_SIGNATURE) if data.startswith(PNG_SIGNATURE) else len(data)
    while at + 8 <= len(data):
        (length,), name = struct.unpack(">I", data[at : at + 4]), data[at + 4 : at + 8]
        if name == b"IDAT":
            return
        yield name, data[at + 8 : at + 8 + length]
        at += 12 + length
