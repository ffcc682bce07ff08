"""controller.jsonl of a recording: all that the state was made of, but for the pictures, in the order in which it was
taken. With what is decoded of the pictures it gives the same states again, to the bit.
"""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from pydantic import BaseModel, ConfigDict, model_validator
from typing_extensions import Self

from ledpi.camera.recording.format import read_lines
from ledpi.core.errors import WireError
from ledpi.core.records import MarkerPose, Rejected
from ledpi.state.estimator import State
from ledpi.state.inputs import Odometry
from ledpi.wire.codec import FROM_CONTROLLER
from ledpi.wire.keeper import Asked, Heard, Keeper, Seen, Told
from ledpi.wire.message import Message

DIARY_FILE = "controller.jsonl"
_MESSAGES = {message.name: message for message in FROM_CONTROLLER}


class Frame(NamedTuple):
    """A mark: here the panels of a frame were taken."""

    seq: int
    now_ns: int
    host_offset_ns: int


class Look(NamedTuple):
    """A mark: here the state was told."""

    t_ns: int


Entry: TypeAlias = Heard | Asked | Told | Frame | Look


def line_of(entry: Entry) -> str:
    """Without its end. Times are of CLOCK_MONOTONIC; of a frame, what to add to the recording's times to get these."""
    match entry:
        case Heard():
            values: dict[str, Any] = {"heard_ns": entry.now_ns, "message": entry.message.name, **_values(entry.message)}
        case Told():
            values = {"told_ns": entry.now_ns, **_values(entry.odometry)}
        case Asked():
            values = {"asked_ns": entry.first_byte_ns, "number": entry.number}
        case Frame():
            values = {"decoded_ns": entry.now_ns, "seq": entry.seq, "host_offset_ns": entry.host_offset_ns}
        case Look():
            values = {"state_ns": entry.t_ns}
    return json.dumps(values)


def _values(record: Message | Odometry) -> dict[str, Any]:
    """Fields by name: not as deep as asdict, and three times as fast."""
    return {field.name: getattr(record, field.name) for field in fields(record)}


class _Line(BaseModel):
    model_config = ConfigDict(extra="allow")

    @model_validator(mode="after")
    def _is_an_entry(self) -> Self:
        try:
            _entry_of(self.model_extra or {})
        except (KeyError, TypeError, WireError) as error:
            raise ValueError(f"is no line of this file ({error})") from None
        return self


def _entry_of(values: dict[str, Any]) -> Entry:
    """Raises KeyError, TypeError or WireError."""
    rest = dict(values)
    if not all(value is None or isinstance(value, int | float) for key, value in rest.items() if key != "message"):
        raise TypeError("a value is no number")
    if "heard_ns" in rest:
        return Heard(now_ns=_whole(rest.pop("heard_ns")), message=_MESSAGES[rest.pop("message")](**rest))
    if "told_ns" in rest:
        return Told(now_ns=_whole(rest.pop("told_ns")), odometry=Odometry(t_ns=_whole(rest.pop("t_ns")), **rest))
    if "asked_ns" in rest:
        return Asked(number=_whole(rest["number"]), first_byte_ns=_whole(rest["asked_ns"]))
    if "decoded_ns" in rest:
        return Frame(*(_whole(rest[key]) for key in ("seq", "decoded_ns", "host_offset_ns")))
    return Look(_whole(rest["state_ns"]))


def _whole(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError(f"must be a whole number, not {value!r}")
    return value


def read_diary(folder: Path) -> list[Entry] | None:
    """None where a recording has none. Raises RecordingError."""
    path = folder / DIARY_FILE
    if not path.exists():
        return None
    return [entry for _, entry in read_lines(path, _Line, lambda line: _entry_of(line.model_extra or {}))[0]]


class Replay:
    """The states of a recording again, while its frames are decoded, in their order."""

    def __init__(self, keeper: Keeper, diary: list[Entry]) -> None:
        self._keeper, self._diary = keeper, iter(diary)
        self._seqs = {entry.seq for entry in diary if isinstance(entry, Frame)}
        self.host_offset_ns = 0  # what to add to the recording's times to get the states'

    def take(self, seq: int, markers: tuple[MarkerPose, ...]) -> list[tuple[int, State | Rejected]]:
        """Takes a frame and what came before it. Returns the states that were told meanwhile, with their times.

        A frame that was not taken then, as it showed nothing, is not taken now.
        """
        told = []
        for entry in self._diary if seq in self._seqs else ():
            if isinstance(entry, Look):
                told.append((entry.t_ns, self._keeper.at(entry.t_ns)))
            elif not isinstance(entry, Frame):
                self._keeper.take(entry)
            elif entry.seq == seq:
                self.host_offset_ns = entry.host_offset_ns
                self._keeper.take(seen(markers, entry.host_offset_ns, entry.now_ns))
                break
        return told


def seen(markers: tuple[MarkerPose, ...], host_offset_ns: int, now_ns: int) -> Seen:
    """Panels of the camera's clock on ours."""
    return Seen(tuple(replace(m, mid_exposure_ns=m.mid_exposure_ns + host_offset_ns) for m in markers), now_ns)
