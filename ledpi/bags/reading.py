"""A bag's messages, one after the other, whatever kind of bag: memory holds one chunk of it."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from mcap.exceptions import McapError
from mcap.records import Channel, McapRecord, Metadata, Schema
from mcap.records import Message as Record
from mcap.stream_reader import CRCValidationError, StreamReader
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ledpi.core.errors import RecordingError

MAX_RECORD_BYTES = 1 << 28  # of a chunk; rosbag2 makes them 768 kB by default

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
            for record in _Records(file, validate_crcs=True, record_size_limit=MAX_RECORD_BYTES).records:
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
        except (McapError, EOFError, ValueError, struct.error) as error:
            if not channels:
                raise RecordingError(f"{path}: is no MCAP file ({str(error) or 'it ends at once'})") from None
            warn(f"{path}: is cut off; what stands before that is read")


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
    except (AnyReaderError, OSError, ValueError, KeyError) as error:
        wanted = "must be an .mcap file, a ROS 2 bag's folder or a ROS 1 .bag"
        if path.suffix == ".bag":
            wanted += "; of one that was cut off `rosbag reindex` makes the index anew"
        raise RecordingError(f"{path}: is no bag that can be read ({error}); {wanted}") from None


def _full(name: str) -> str:
    """`sensor_msgs/msg/Image`, also where a file says `sensor_msgs/Image`."""
    package, _, rest = name.partition("/")
    return name if rest.startswith("msg/") else f"{package}/msg/{rest}"
