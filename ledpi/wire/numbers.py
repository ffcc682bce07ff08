"""Numbers of the packets: what stands for unknown, where a scale ends, and deviations as logarithmic bytes. Pure."""

from __future__ import annotations

import math
from typing import TypeAlias

from ledpi.core.errors import WireError

Triple: TypeAlias = tuple[float, float, float]

BITS_PER_BYTE = 10  # on the line, 8N1: start bit, eight of data, stop bit
UNITS_PER_SI = 10_000  # a step is 0.1 mm or 0.1 mrad: finer than a pose is known; 24 bits still reach 838 m
POSITION_MAX_UNITS = 0x7FFFFF
I24_UNKNOWN = -0x800000
DEVIATION_UNKNOWN = 255


class UnknownFlagsError(WireError):
    """A flag of a newer sender. Each is a caution, so the message is skipped."""


def check_flags(flags: int, known: int) -> None:
    """Raises UnknownFlagsError."""
    if flags & ~known:
        raise UnknownFlagsError(f"flags 0x{flags:02x}; this receiver knows 0x{known:02x}")


def check_range(name: str, value: int, maximum: int | None = None) -> None:
    """Raises WireError."""
    if value < 0 or (maximum is not None and value > maximum):
        limit = "0 or more" if maximum is None else f"0 to {maximum}"
        raise WireError(f"{name} must be {limit}, not {value}")


def limited(value: int | None, top: int, *, unknown: bool = False) -> int:
    """Saturated at `top`, or, where `top` itself stands for unknown, one below it."""
    if value is None:
        return top
    return min(value, top - 1 if unknown else top)


def known(value: int, unknown: int) -> int | None:
    """None where it stands for unknown."""
    return None if value == unknown else value


def i24(*values: int) -> bytes:
    """Three bytes each."""
    return b"".join(value.to_bytes(3, "little", signed=True) for value in values)


def from_i24(packed: bytes) -> list[int]:
    """The same back."""
    return [int.from_bytes(packed[i : i + 3], "little", signed=True) for i in range(0, len(packed), 3)]


def wrapped32(value: int) -> int:
    """Modulo 2³², from -2³¹ to 2³¹ - 1: the step between two wrapping totals."""
    return (value + 0x80000000) % 0x100000000 - 0x80000000


def pack_deviations(deviations: Triple | None) -> list[int]:
    """Three bytes."""
    return [DEVIATION_UNKNOWN] * 3 if deviations is None else [deviation_code(d) for d in deviations]


def unpack_deviations(codes: tuple[int, ...]) -> Triple | None:
    """None unless all three are known."""
    if DEVIATION_UNKNOWN in codes:
        return None
    a, b, c = (deviation_value(code) for code in codes)
    return a, b, c


def deviation_code(deviation: float) -> int:
    """The smallest code whose value is not less: below the top, a deviation is never understated.

    A logarithmic byte: high half e, low half m; the value is m for e = 0 and (16 + m)·2^(e − 1) above, in
    steps of 0.1 mm or 0.1 mrad. Exact to 31 steps, within 1/16 to 49.152 (m or rad); 254 is that or more.
    """
    # 1e-6 of a step: a value that *is* a whole number of steps must not be lifted by its last binary digit.
    steps = math.ceil(min(deviation, 1e3) * UNITS_PER_SI - 1e-6)
    if steps < 16:
        return max(steps, 0)
    shift = steps.bit_length() - 5
    mantissa = -(-steps >> shift)  # rounded up; 32 carries into the exponent by the sum below
    return min((shift + 1 << 4) + mantissa - 16, DEVIATION_UNKNOWN - 1)


def deviation_value(code: int) -> float:
    """Returns what a code below 255 stands for, in m or rad."""
    exponent, mantissa = code >> 4, code & 15
    return (mantissa if exponent == 0 else (16 + mantissa) << (exponent - 1)) / UNITS_PER_SI
