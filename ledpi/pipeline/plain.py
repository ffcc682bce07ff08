"""Plain values out of a file that anybody may have written, each taken as what it must be; and a room for arrays.

An array stands as `[start, rows, columns, …]`: where in the room its bytes begin, and its shape. Its type is not there:
who reads it knows it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ledpi.core.wording import shortened

Made = TypeVar("Made")

MOST = 1e30  # of any number: squares of it can still be told from infinity
_ALIGNED = 8  # bytes


class Room:
    """The bytes of arrays, one after the other."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.size = 0

    def put(self, array: NDArray[Any]) -> list[int]:
        """What stands for it."""
        content = array.astype(array.dtype.newbyteorder("<"), order="C", copy=False).tobytes()
        content += bytes(-len(content) % _ALIGNED)
        start, self.size = self.size, self.size + len(content)
        self.parts.append(content)
        return [start, *array.shape]


@dataclass(frozen=True, slots=True)
class Node:
    """A value, with where it is. Everything raises ValueError, which says that, and what would be right."""

    value: Any
    room: bytes
    where: str = ""

    def wrong(self, wanted: str) -> ValueError:
        """What to raise for another thing than `wanted`."""
        return ValueError(f"{self.where or 'the state'}: must be {wanted}, not {shortened(self.value)}")

    def __getitem__(self, key: str) -> Node:
        """The value of a mapping's key."""
        if not isinstance(self.value, dict):
            raise self.wrong("a mapping")
        where = f"{self.where}.{key}" if self.where else key
        if key not in self.value:
            raise ValueError(f"{where}: is missing; must be given")
        return Node(self.value[key], self.room, where)

    def each(self, most: int, *, least: int = 0) -> list[Node]:
        """The values of a list."""
        if not isinstance(self.value, list) or not least <= len(self.value) <= most:
            raise self.wrong(f"a list of {least} to {most}")
        return [Node(each, self.room, f"{self.where}.{number}") for number, each in enumerate(self.value)]

    def two(self, made: Callable[[Node], Made]) -> tuple[Made, Made]:
        """Of a list of two what is `made` of each."""
        first, second = self.each(2, least=2)
        return made(first), made(second)

    def pairs(self, most: int) -> list[tuple[Node, Node]]:
        """The values of a list of lists of two."""
        return [each.two(lambda one: one) for each in self.each(most)]

    def maybe(self, made: Callable[[Node], Made]) -> Made | None:
        """None for null, else what is `made` of it."""
        return None if self.value is None else made(self)

    def flag(self) -> bool:
        """True or false."""
        if not isinstance(self.value, bool):
            raise self.wrong("true or false")
        return self.value

    def natural(self, most: int = 2**63 - 1, *, least: int = 0) -> int:
        """A whole number within these, which belong to it."""
        if type(self.value) is not int or not least <= self.value <= most:
            raise self.wrong(f"a whole number from {least} to {most}")
        return self.value

    def real(self, least: float = -MOST, most: float = MOST) -> float:
        """A finite number within these, which belong to it."""
        if type(self.value) not in (int, float) or not least <= self.value <= most:
            raise self.wrong(f"a number from {least:g} to {most:g}")
        return float(self.value)

    def one_of(self, *known: str) -> str:
        """One of these words."""
        if not isinstance(self.value, str) or self.value not in known:
            raise self.wrong(" or ".join(known))
        return self.value

    def array(self, kind: type[np.generic], *shape: int | None, most: float = MOST) -> NDArray[Any]:
        """An array of that type and shape (None: any length), its numbers finite and within ±`most`."""
        start, *given = [each.natural() for each in self.each(len(shape) + 1, least=len(shape) + 1)]
        dtype = np.dtype(kind).newbyteorder("<")
        if any(wanted is not None and wanted != is_so for wanted, is_so in zip(shape, given, strict=True)):
            raise self.wrong(f"[start, {', '.join('any' if size is None else str(size) for size in shape)}]")
        count = math.prod(given)
        if start % _ALIGNED or start + count * dtype.itemsize > len(self.room):
            raise self.wrong(f"within the {len(self.room)} bytes of arrays that follow")
        array = np.frombuffer(self.room, dtype, count, start).reshape(given).astype(kind)
        if kind is np.bool_ and (np.frombuffer(self.room, np.uint8, count, start) > 1).any():
            raise self.wrong("an array of bytes 0 and 1")
        if kind is not np.bool_ and not (np.abs(array) <= most).all():
            raise self.wrong(f"an array of numbers within ±{most:g}")
        return array
