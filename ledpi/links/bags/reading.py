"""A bag's messages, one after the other, whatever kind of bag: memory holds one chunk of it."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Metadata, Schema
from mcap.records import Message as Record
from mcap.stream_reader import CRCValidationError, StreamReader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ledpi.core.errors import LedpiError, RecordingError, one_line, shortened_name

MAX_RECORD_BYTES = 1 << 26  # of a chunk, packed and unpacked; rosbag2 makes them 768 kB by default

Warn = Callable[[str], None]


class Item(NamedTuple):
    """A message, or a file's metadata (`type` is empty, `topic` its name, and `read` gives its words)."""

    topic: str
    type: str
    read: Callable[[], Any]


def messages(path: Path, warn: Warn) -> Iterator[Item]:
    """All of a bag: an .mcap file, a ROS 2 bag's folder, or a ROS 1 .bag. Raises RecordingError where it is none.

    A file that is cut off is read up to there, with a warning.
    """
    if not path.exists():
        raise RecordingError(f"{path}: no such file or folder")
    yield from _of_mcap(path, warn) if path.suffix == ".mcap" and path.is_file() else _of_any(path)


def _of_mcap(path: Path, warn: Warn) -> Iterator[Item]:
    """In the order of the file, from its beginning: so one without its index can be read, too."""
    channels: dict[int, Channel] = {}
    schemas: dict[int, Schema] = {}
    types = _Types(path)
    with path.open("rb") as file:
        try:
            for record in _records(file):
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Metadata):
                    yield Item(record.name, "", lambda words=record.metadata: words)  # type: ignore[misc]
                elif isinstance(record, Record) and record.channel_id in channels:
                    channel = channels[record.channel_id]
                    schema = schemas.get(channel.schema_id)
                    if schema is not None and channel.message_encoding == "cdr":
                        yield Item(channel.topic, _full(schema.name), types.reader(schema, record.data))
        except CRCValidationError:
            warn(f"{path}: is damaged (a checksum is wrong); what stands before that is read: copy the bag once more")
        except (McapError, EOFError, ValueError, struct.error, zstandard.ZstdError, RuntimeError) as error:
            if not channels:
                why = one_line(str(error)) or "it ends at once"
                raise RecordingError(f"{path}: is no MCAP file ({why})") from None
            warn(f"{path}: is cut off; what stands before that is read")


def _records(file: BinaryIO) -> Iterator[McapRecord]:
    """One after the other, also those of a chunk: a list of millions of empty ones would take hundreds of megabytes."""
    for record in _Records(file, emit_chunks=True, validate_crcs=True, record_size_limit=MAX_RECORD_BYTES).records:
        if isinstance(record, Chunk):
            yield from _of_chunk(record)
        else:
            yield record


def _of_chunk(chunk: Chunk) -> Iterator[McapRecord]:
    data = _unpacked(chunk)
    if chunk.uncompressed_crc not in (0, crc := zlib.crc32(data)):
        raise CRCValidationError(chunk.uncompressed_crc, crc, chunk)
    stream = ReadDataStream(BytesIO(data))
    while stream.count < len(data):
        opcode, length = stream.read1(), stream.read8()
        if length > len(data) - stream.count:
            raise EOFError
        if opcode == Opcode.CHANNEL:
            yield Channel.read(stream)
        elif opcode == Opcode.MESSAGE:
            yield Record.read(stream, length)
        elif opcode == Opcode.SCHEMA:
            yield Schema.read(stream)
        else:
            stream.read(length)


def _unpacked(chunk: Chunk) -> bytes:
    """As many bytes as it says, and no more of what its packed data would grow to."""
    size = chunk.uncompressed_size
    if size > MAX_RECORD_BYTES:
        raise ValueError(f"a chunk of {size:,} bytes; must be at most {MAX_RECORD_BYTES:,}")
    if chunk.compression == "zstd":
        data = zstandard.ZstdDecompressor(max_window_size=MAX_RECORD_BYTES).stream_reader(chunk.data).read(size + 1)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    elif chunk.compression:
        raise ValueError(f"a chunk packed by {shortened_name(chunk.compression)}; must be zstd or lz4")
    else:
        data = chunk.data
    if len(data) != size:
        raise ValueError(f"a chunk that is not the {size:,} bytes that it says")
    return data


class _Records(StreamReader):
    """Ends at zeros, as a power failure leaves them in the place of what was not yet on the disk."""

    def _read_record(self, opcode: int, length: int) -> McapRecord | None:
        if opcode == 0:  # MCAP's own "no record"
            raise EOFError
        return super()._read_record(opcode, length)


class _Types:
    """The types that a file itself describes."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._store = get_typestore(Stores.EMPTY)

    def reader(self, schema: Schema, data: bytes) -> Callable[[], Any]:
        def read() -> Any:
            name = _full(schema.name)
            try:
                if name not in self._store.fielddefs:
                    self._store.register(get_types_from_msg(schema.data.decode(), name))
                return self._store.deserialize_cdr(data, name)
            except MemoryError:
                raise
            except Exception as error:  # whatever rosbags meets in a message that is none
                raise RecordingError(f"{self._path}: holds a broken {name}: {type(error).__name__}") from None

        return read


def _of_any(path: Path) -> Iterator[Item]:
    store = get_typestore(Stores.ROS2_HUMBLE)  # for bags that do not describe their types
    try:
        with AnyReader([path], default_typestore=store) as reader:
            for connection, _, data in reader.messages():
                kind = connection.msgtype
                yield Item(connection.topic, kind, lambda d=data, k=kind: reader.deserialize(d, k))  # type: ignore[misc]
    except (LedpiError, MemoryError):
        raise
    except Exception as error:  # whatever rosbags meets in files that are none
        wanted = "must be an .mcap file, a ROS 2 bag's folder or a ROS 1 .bag"
        if path.suffix == ".bag":
            wanted += "; of one that was cut off `rosbag reindex` makes the index anew"
        raise RecordingError(
            f"{path}: is no bag that can be read ({one_line(str(error) or type(error).__name__)}); {wanted}"
        ) from None


def _full(name: str) -> str:
    """`sensor_msgs/msg/Image`, also where a file says `sensor_msgs/Image`."""
    package, _, rest = name.partition("/")
    return name if rest.startswith("msg/") else f"{package}/msg/{rest}"
