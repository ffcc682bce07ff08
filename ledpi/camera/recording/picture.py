"""One picture file → pixels and its words, or a frame. What cannot be used of a recording is a value with a message.

OpenCV says only that it cannot decode, and prints its own words to standard error; half a picture that some
version might take for a whole one would be decoded as if it had been seen. So the PNG's own structure
(lengths, checksums, end mark) is checked first: 0.1 ms, where decoding takes 3 ms.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ledpi.camera.base import frame_by
from ledpi.config.settings import CameraSettings
from ledpi.config.values import MAX_SIDE_PX
from ledpi.core.errors import ConfigError, RecordingError
from ledpi.core.files import parse_json, read_bytes
from ledpi.core.records import CameraInfo, Frame, Pixels, Rejected

MAX_BYTES = 4 * MAX_SIDE_PX**2  # of a file: the largest picture, in colour and not compressed
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY, _COLOUR_TYPES = 0, {0: "grey", 2: "colour", 3: "palette", 4: "grey with alpha", 6: "colour with alpha"}
_IHDR_END = 8 + 4 + 4 + 13 + 4  # signature, then the first chunk's length, name, content and checksum

KEYWORD = b"ledpi"
MAX_TEXT_BYTES = 1 << 20  # of the text: a map of a thousand panels takes 200 kB


@dataclass(frozen=True, slots=True, kw_only=True)
class BadPicture:
    """Why a picture cannot be used: what to count, and one line for the user that names the file."""

    rejected: Rejected  # stage `capture`, reason `unreadable`, `truncated` or `wrong_size`
    message: str


def read_picture(path: Path, into: Pixels) -> BadPicture | None:
    """Reads an 8-bit grey PNG into `into` (H, W) uint8. None when that worked; else `into` is untouched."""

    def bad(reason: str, what: str) -> BadPicture:
        return BadPicture(rejected=Rejected(stage="capture", reason=reason), message=f"{path}: {what}")

    height, width = into.shape
    try:
        data = read_bytes(path, RecordingError, MAX_BYTES)
    except RecordingError as error:
        return BadPicture(rejected=Rejected(stage="capture", reason="unreadable"), message=str(error))
    fault = _fault(data, width, height)
    if fault is not None:
        return bad(*fault)
    try:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        picture = None
    if picture is None or picture.shape != into.shape or picture.dtype != np.uint8:
        return bad("unreadable", "its content is not a PNG picture that OpenCV can decode")
    np.copyto(into, picture)
    return None


def _fault(data: bytes, width: int, height: int) -> tuple[str, str] | None:
    """(reason, what is wrong) where bytes are no whole 8-bit grey PNG of this size (PNG specification §5)."""
    if not data:
        return "truncated", "is empty; must be an 8-bit grey PNG"
    if not data.startswith(PNG_SIGNATURE):
        if PNG_SIGNATURE.startswith(data):
            return "truncated", f"ends after {len(data)} bytes, inside the PNG signature"
        return "unreadable", "is not a PNG file; must be an 8-bit grey PNG"
    if len(data) >= _IHDR_END:
        fault = _header_fault(data, width, height)
        if fault is not None:
            return fault
    return png_fault(data)


def _header_fault(data: bytes, width: int, height: int) -> tuple[str, str] | None:
    if data[8:16] != b"\0\0\0\x0dIHDR":
        return "unreadable", "does not begin with the chunk IHDR, which tells a PNG's size"
    size = int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")
    depth, colour = data[24], data[25]
    if zlib.crc32(data[12:29]) != int.from_bytes(data[29:33], "big"):
        return "unreadable", "its chunk IHDR at byte 8 is damaged (wrong checksum)"
    if (depth, colour) != (8, _GREY):
        kind = _COLOUR_TYPES.get(colour, f"colour type {colour}")
        return "unreadable", f"is {depth}-bit {kind}; must be 8-bit grey"
    if size != (width, height):
        return "wrong_size", f"is {size[0]} × {size[1]} pixels; must be {width} × {height}"
    return None


def png_fault(data: bytes) -> tuple[str, str] | None:
    """(reason, what is wrong) where bytes that begin as a PNG are cut off or damaged. Looks at no content."""
    position = len(PNG_SIGNATURE)
    while position < len(data):
        length = int.from_bytes(data[position : position + 4], "big")
        name = data[position + 4 : position + 8]
        end = position + 12 + length
        if end > len(data):
            inside = f"chunk {name.decode('ascii', 'replace')}" if len(name) == 4 else "a chunk's header"
            return "truncated", f"ends after {len(data)} bytes, inside {inside}"
        if zlib.crc32(memoryview(data)[position + 4 : end - 4]) != int.from_bytes(data[end - 4 : end], "big"):
            return "unreadable", f"its chunk at byte {position} is damaged (wrong checksum)"
        if name == b"IEND":
            return None
        position = end
    return "truncated", f"ends after {len(data)} bytes without the end mark IEND"


def with_text(png: bytes, values: Mapping[str, Any]) -> bytes:
    """The PNG with these values, as JSON has them, after its header. Pixels stay as they are."""
    body = b"tEXt" + KEYWORD + b"\0" + json.dumps(values).encode("ascii")
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    return png[:_IHDR_END] + chunk + png[_IHDR_END:]


def text_of(data: bytes) -> dict[str, Any] | None:
    """Returns what `with_text` wrote; None where the bytes are no PNG, or say nothing of the kind."""
    for name, content in _chunks(data):
        keyword, _, text = content.partition(b"\0")
        if name == b"tEXt" and keyword == KEYWORD and len(text) <= MAX_TEXT_BYTES:
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


SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".tif", ".tiff"}
# The file's own orientation mark is passed over: lens and shutter belong to the sensor's rows and columns.
_AS_EXPOSED = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
_DEPTHS = (8, 10, 12, 14, 16)  # bits, of the 16 in which sensors' values are stored


def still_camera(settings: CameraSettings) -> CameraInfo:
    """Returns the camera that took a picture, by the configuration. Raises ConfigError where that leaves it open."""
    if settings.row_time_us == "auto":
        raise ConfigError(
            "a picture file has no row time: add --set camera.row_time_us=33.67 (OV5647; other cameras: "
            "docs/raspberry-pi.md#other-cameras)"
        )
    return CameraInfo(
        width=settings.width,
        height=settings.height,
        exposure_us=settings.exposure_us,
        row_time_us=settings.row_time_us,
        transfer="srgb" if settings.transfer == "auto" else settings.transfer,
        rows_from=settings.rows_from,
    )


def read_still(path: Path, camera: CameraInfo, seq: int = 0) -> Frame:
    """The picture as a frame at time 0. Raises RecordingError where it cannot be read or has another size."""
    wanted = f"must be {camera.width} × {camera.height}"
    data = read_bytes(path, RecordingError, MAX_BYTES)
    fault = png_fault(data) if data.startswith(PNG_SIGNATURE) else None
    if fault is not None:
        raise RecordingError(f"{path}: {fault[1]}")
    picture = decode_grey(data)
    if picture is None:
        raise RecordingError(f"{path}: cannot be read as a picture of 8 or 16 bits; {wanted}")
    if picture.shape != (camera.height, camera.width):
        raise RecordingError(f"{path}: is {picture.shape[1]} × {picture.shape[0]}; {wanted}")
    return frame_by(camera, picture, seq)


def decode_grey(data: bytes) -> Pixels | None:
    """A picture file's grey values (H, W), its rows as they were exposed; None where it has none of 8 or 16 bits.

    Of 16 bits the upper eight of those that are used: a sensor of 10 or 12 bits leaves the others 0, and taken as they
    stand its pictures would be black.
    """
    if not data:
        return None
    coded = np.frombuffer(data, np.uint8)
    try:
        picture = cv2.imdecode(coded, _AS_EXPOSED | cv2.IMREAD_ANYDEPTH)
        if picture is not None and picture.dtype == np.uint8:
            return np.asarray(cv2.imdecode(coded, _AS_EXPOSED), np.uint8)
    except cv2.error:
        return None
    if picture is None or picture.dtype != np.uint16:
        return None
    bits = next(depth for depth in _DEPTHS if int(picture.max()) < 1 << depth)
    return np.asarray(picture >> (bits - 8), np.uint8)
