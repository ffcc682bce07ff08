"""The tap's lines: what a client may ask, and how lines are written and read. docs/tap.md describes them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, TypeGuard, cast, get_args

from ledpi.state.inputs import Odometry

VERSION = 1
MAX_REQUEST_BYTES = 4096  # of a line that a client sends, its end included
MIN_SECONDS, MAX_SECONDS = 1.0, 600.0  # that `record` takes at once
MAX_ID_LENGTH = 64

Do = Literal["picture", "config", "save", "record", "record_stop", "takes", "take", "take_delete", "reload", "odometry"]
Extra = Literal["rejected", "evidence"]
RequestId: TypeAlias = int | str | None
# What changes or reads files, and is not permitted to everybody.
COMMANDS: tuple[Do, ...] = ("save", "record", "record_stop", "takes", "take", "take_delete", "reload", "odometry")
AT_ONCE: tuple[Do, ...] = ("odometry",)  # what takes no time, and is answered only where it has an id
NAMED: tuple[Do, ...] = ("save", "record", "odometry")  # in a hello: whoever may `record` may do the others

TOTALS = ("left_m", "right_m", "yaw_rad")  # of odometry
FLAGS = ("restarted", "lifted", "slipping")

_KEYS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(get_args(Do), ()),
    "picture": ("with",),
    "record": ("seconds",),
    "take": ("name", "offset"),
    "take_delete": ("name",),
    "odometry": ("t_ns", *TOTALS, *FLAGS),
}


class RequestError(ValueError):
    """A line that is no request: what is wrong, and what would be right. `id`: as given, where that could be read."""

    def __init__(self, text: str, request_id: RequestId = None) -> None:
        super().__init__(text)
        self.id = request_id


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """A client's request."""

    do: Do
    id: RequestId = None
    extras: frozenset[Extra] = frozenset()  # of `picture`: what else comes with it
    seconds: float | None = None  # of `record`; None: as long as it may
    name: str | None = None  # of a take
    offset: int = 0  # in its tar file
    odometry: Odometry | None = None


def read_request(line: bytes) -> Request:
    """Raises RequestError."""
    try:
        values = json.loads(line)
    except (ValueError, RecursionError):  # of UTF-8, of JSON, and of a thousand brackets
        raise RequestError('is not JSON; must be a line such as {"do": "picture", "id": 1}') from None
    if not isinstance(values, dict):
        raise RequestError('must be a JSON object such as {"do": "picture", "id": 1}')
    request_id = _id(values.pop("id", None))
    do = values.pop("do", None)
    if not isinstance(do, str) or do not in _KEYS:
        raise RequestError(f"do: must be one of {', '.join(_KEYS)}", request_id)
    unknown = sorted(values.keys() - set(_KEYS[do]))
    if unknown:
        known = ", ".join(("do", "id", *sorted(_KEYS[do])))
        raise RequestError(f"{unknown[0][:MAX_ID_LENGTH]}: unknown key; {do} has the keys {known}", request_id)
    for key, value in values.items():
        is_right, right = _VALUES[key]
        if not is_right(value):
            raise RequestError(f"{key}: must be {right}", request_id)
    if do == "odometry":
        return Request(do="odometry", id=request_id, odometry=_odometry(values, request_id))
    extras = frozenset[Extra](values.pop("with", ()))
    return Request(do=cast(Do, do), id=request_id, extras=extras, **values)


def _id(value: object) -> RequestId:
    if value is None or _is_text(value) or (_is_whole(value) and abs(value) < 1 << 53):
        return value
    raise RequestError(f"id: must be a whole number, or a text of {MAX_ID_LENGTH} characters at most")


def _is_text(value: object) -> TypeGuard[str]:
    return isinstance(value, str) and len(value) <= MAX_ID_LENGTH


def _is_whole(value: object) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_time(value: object) -> bool:
    return (_is_whole(value) or isinstance(value, float)) and MIN_SECONDS <= value <= MAX_SECONDS


def _is_total(value: object) -> bool:
    return (_is_whole(value) or isinstance(value, float)) and abs(value) <= 1e9


# Whether a value is right, and which would be.
_VALUES: dict[str, tuple[Callable[[Any], bool], str]] = {
    "with": (
        lambda value: isinstance(value, list) and all(item in get_args(Extra) for item in value),
        f"a list of {', '.join(get_args(Extra))}",
    ),
    "seconds": (lambda value: value is None or _is_time(value), f"a number from {MIN_SECONDS:g} to {MAX_SECONDS:g}"),
    "name": (lambda value: value is None or _is_text(value), f"a text of {MAX_ID_LENGTH} characters at most"),
    "offset": (lambda value: _is_whole(value) and 0 <= value < 1 << 53, "a whole number from 0 on"),
    "t_ns": (lambda value: _is_whole(value) and 0 <= value < 1 << 63, "a whole number, of CLOCK_MONOTONIC in ns"),
    **dict.fromkeys(TOTALS, (lambda value: value is None or _is_total(value), "a number of m or rad, or null")),
    **dict.fromkeys(FLAGS, (lambda value: isinstance(value, bool), "true or false")),
}


def _odometry(values: dict[str, Any], request_id: RequestId) -> Odometry:
    if "t_ns" not in values:
        raise RequestError("t_ns: is missing; must be the time of CLOCK_MONOTONIC in ns", request_id)
    if (values.get("left_m") is None) != (values.get("right_m") is None):
        raise RequestError("left_m, right_m: must be two numbers, or none", request_id)
    return Odometry(**values)


def error(text: str, request_id: RequestId = None, *, again: bool = False) -> dict[str, Any]:
    """The answer to what cannot be done. `again`: it may be possible later, though nobody asks otherwise."""
    return {"type": "error", "id": request_id, "error": text} | ({"again": True} if again else {})


def write_line(values: dict[str, Any]) -> bytes:
    """One line, its end included. What is no finite number is null: JSON has no other word for it."""
    try:
        text = json.dumps(values, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    except ValueError:
        text = json.dumps(_finite(values), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.encode("utf-8", "backslashreplace") + b"\n"


def with_dropped(line: bytes, dropped: int) -> bytes:
    """A written line, with what is its client's own: how many `decoded` it has missed so far."""
    return b'%s,"dropped":%d}\n' % (line[:-2], dropped)


def read_line(line: bytes) -> dict[str, Any]:
    """A line of the daemon. Raises ValueError where it is none."""
    values = json.loads(line)
    if not isinstance(values, dict) or not isinstance(values.get("type"), str):
        raise ValueError("a line of the tap must be a JSON object with a type")
    return values


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
