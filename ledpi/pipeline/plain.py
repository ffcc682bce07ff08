"""Plain values from a file of any origin, each checked as it is read; and a store for arrays.

An array is `[start, rows, columns, …]` there: the offset of its bytes in the store, and its shape. Its type is not in
the file: the reader knows it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ledpi.core.wording import shortened

T = TypeVar("T")

MAX_NUMBER = 1e30  # of any number: its square is still finite
_ALIGNED = 8  # bytes


class ArrayStore:
    """The bytes of arrays, one after the other."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.size = 0

    def add(self, array: NDArray[Any]) -> list[int]:
        """The array's offset and shape."""
        content = array.astype(array.dtype.newbyteorder("<"), order="C", copy=False).tobytes()
        content += bytes(-len(content) % _ALIGNED)
        start, self.size = self.size, self.size + len(content)
        self.parts.append(content)
        return [start, *array.shape]


@dataclass(frozen=True, slots=True)
class Node:
    """A value and its path. Each method raises ValueError with the path, the value, and what would be right."""

    value: Any
    arrays: bytes  # of an ArrayStore
    path: str = ""

    def error(self, wanted: str) -> ValueError:
        """What to raise if the value is not `wanted`."""
        return ValueError(f"{self.path or 'the state'}: must be {wanted}, not {shortened(self.value)}")

    def __getitem__(self, key: str) -> Node:
        """The value of a mapping's key."""
        if not isinstance(self.value, dict):
            raise self.error("a mapping")
        path = f"{self.path}.{key}" if self.path else key
        if key not in self.value:
            raise ValueError(f"{path}: is missing; must be given")
        return Node(self.value[key], self.arrays, path)

    def items(self, max_count: int, *, min_count: int = 0) -> list[Node]:
        """The values of a list."""
        if not isinstance(self.value, list) or not min_count <= len(self.value) <= max_count:
            raise self.error(f"a list of {min_count} to {max_count}")
        return [Node(item, self.arrays, f"{self.path}.{number}") for number, item in enumerate(self.value)]

    def pair(self, parse: Callable[[Node], T]) -> tuple[T, T]:
        """A list of two, both parsed."""
        first, second = self.items(2, min_count=2)
        return parse(first), parse(second)

    def pairs(self, max_count: int) -> list[tuple[Node, Node]]:
        """The values of a list of lists of two."""
        return [item.pair(lambda node: node) for item in self.items(max_count)]

    def optional(self, parse: Callable[[Node], T]) -> T | None:
        """None for null, else the value parsed."""
        return None if self.value is None else parse(self)

    def boolean(self) -> bool:
        """True or false."""
        if not isinstance(self.value, bool):
            raise self.error("true or false")
        return self.value

    def integer(self, max_value: int = 2**63 - 1, *, min_value: int = 0) -> int:
        """A whole number within these limits, inclusive."""
        if type(self.value) is not int or not min_value <= self.value <= max_value:
            raise self.error(f"a whole number from {min_value} to {max_value}")
        return self.value

    def real(self, min_value: float = -MAX_NUMBER, max_value: float = MAX_NUMBER) -> float:
        """A finite number within these limits, inclusive."""
        if type(self.value) not in (int, float) or not min_value <= self.value <= max_value:
            raise self.error(f"a number from {min_value:g} to {max_value:g}")
        return float(self.value)

    def choice(self, *known: str) -> str:
        """One of these words."""
        if not isinstance(self.value, str) or self.value not in known:
            raise self.error(" or ".join(known))
        return self.value

    def array(self, kind: type[np.generic], *shape: int | None, max_abs: float = MAX_NUMBER) -> NDArray[Any]:
        """An array of that type and shape (None: any length), its numbers finite and within ±`max_abs`."""
        start, *given = [item.integer() for item in self.items(len(shape) + 1, min_count=len(shape) + 1)]
        dtype = np.dtype(kind).newbyteorder("<")
        if any(wanted is not None and wanted != size for wanted, size in zip(shape, given, strict=True)):
            raise self.error(f"[start, {', '.join('any' if size is None else str(size) for size in shape)}]")
        count = math.prod(given)
        if start % _ALIGNED or start + count * dtype.itemsize > len(self.arrays):
            raise self.error(f"within the {len(self.arrays)} bytes of arrays that follow")
        array = np.frombuffer(self.arrays, dtype, count, start).reshape(given).astype(kind)
        if kind is np.bool_ and (np.frombuffer(self.arrays, np.uint8, count, start) > 1).any():
            raise self.error("an array of bytes 0 and 1")
        if kind is not np.bool_ and not (np.abs(array) <= max_abs).all():
            raise self.error(f"an array of numbers within ±{max_abs:g}")
        return array
