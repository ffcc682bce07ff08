"""Values that people write into configurations, maps and recordings: their types, and limits that catch slips."""

from __future__ import annotations

import ipaddress
import math
import re
from collections.abc import Callable, Sequence, Sized
from typing import Annotated, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    field_validator,
    model_validator,
)

MAX_SIDE_M = 10.0  # a longer one was given in millimetres


def _check_metres(side_m: float) -> float:
    if side_m <= MAX_SIDE_M:
        return side_m
    shorter = side_m / 1000
    offer = f" ({side_m:g} mm are {shorter:g})" if shorter <= MAX_SIDE_M else ""
    raise ValueError(f"must be in metres, {MAX_SIDE_M:g} at most{offer}")


# What lies outside these was given in another unit: kilohertz, seconds, nanoseconds, millimetres.
Hertz = Annotated[float, Field(ge=10, le=100_000, allow_inf_nan=False)]  # a bright and a dark row of 5 µs each
Microseconds = Annotated[float, Field(ge=1, le=10_000_000, allow_inf_nan=False)]
RowTime = Annotated[float, Field(ge=1, le=1_000, allow_inf_nan=False)]  # µs; sensors' rows take 5 to 100
SideM = Annotated[float, Field(ge=0.001, allow_inf_nan=False), AfterValidator(_check_metres)]
MAX_SIDE_PX = 5000  # of a picture: the largest sensors that deliver video have 4656 columns
SidePx = Annotated[int, Field(ge=1, le=MAX_SIDE_PX)]
MarkerId = Annotated[int, Field(ge=0, le=65_535)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
MountM = Annotated[float, Field(ge=-10, le=10, allow_inf_nan=False)]  # on a robot
MAX_PLACE_M = 1000.0  # in a map: packets carry 838 m
PlaceM = Annotated[float, Field(ge=-MAX_PLACE_M, le=MAX_PLACE_M, allow_inf_nan=False)]
Degrees = Annotated[float, Field(ge=-360, le=360, allow_inf_nan=False)]
# How well a panel is placed. Less well, and it tells nothing: its deviations' squares would drown those of its corners.
DeviationM = Annotated[float, Field(ge=0, le=10, allow_inf_nan=False)]
DeviationDeg = Annotated[float, Field(ge=0, le=180, allow_inf_nan=False)]
Coefficient = Annotated[float, Field(ge=-1000, le=1000, allow_inf_nan=False)]  # of a lens's distortion
MavlinkProfile = Literal["ardupilot", "px4"]
MavlinkSystem = Annotated[int, Field(ge=1, le=255)]  # a vehicle's; 0 is all of them
MaxAgeMs = Annotated[float, Field(gt=0, le=60_000, allow_inf_nan=False)]
Duty = Annotated[float, Field(ge=0.01, le=0.99)]
Gain = Annotated[float, Field(ge=1, le=64)]
_Auto = Annotated[Literal["auto"], Tag("auto")]
# Only the branch that was meant is tried, so that a wrong number gives one message and not one a branch.
_number_or_auto = Discriminator(lambda value: "auto" if value == "auto" else "number")
RowTimeOrAuto = Annotated[Annotated[RowTime, Tag("number")] | _Auto, _number_or_auto]
MicrosecondsOrAuto = Annotated[Annotated[Microseconds, Tag("number")] | _Auto, _number_or_auto]
GainOrAuto = Annotated[Annotated[Gain, Tag("number")] | _Auto, _number_or_auto]

# Of a picture's width or height. A field of view of 0.6° to 157°: what lies outside was given in millimetres.
FOCAL_LENGTHS = (0.1, 100.0)
CENTRES = (-1.0, 2.0)  # a picture may be a part of the sensor's, and its lens's axis beside it, but not far
_Numbers = TypeVar("_Numbers", bound=Sized)
_Quaternion = TypeVar("_Quaternion", bound=Sequence[float])


def is_ip(text: str) -> bool:
    """Tells whether it is the number of a machine on a network."""
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return False
    return True


def _address(listen: object) -> object:
    if isinstance(listen, str):
        host, _, port = listen.rpartition(":")
        number = host[1:-1] if host.startswith("[") and host.endswith("]") else host
        bracketed = (":" in number) == (number != host)
        known = host == "localhost" or (bracketed and is_ip(number))
        if known and port.isascii() and port.isdigit() and len(port) <= 5 and int(port) <= 65535:
            return listen
    raise ValueError("must be an IP address and a port, as 127.0.0.1:8088, 0.0.0.0:8088 (all of IPv4) or [::]:8088")


Listen = Annotated[str, BeforeValidator(_address)]


def _host_name(name: object) -> object:
    label = r"[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?"
    if isinstance(name, str) and len(name) <= 253 and re.fullmatch(rf"{label}(\.{label})*", name.lower()):
        return name.lower()
    raise ValueError("must be a name alone, as robot.lan: no address, no port, no *")


HostName = Annotated[str, BeforeValidator(_host_name)]
Token = Annotated[str, Field(min_length=12, max_length=200, pattern=r"^[A-Za-z0-9._~+/=-]+$")]


def numbers(*counts: int) -> Callable[[_Numbers], _Numbers]:
    """A validator of how many there are."""

    def check(values: _Numbers) -> _Numbers:
        if len(values) in counts:
            return values
        raise ValueError(f"must be {' or '.join(map(str, counts))} numbers")

    return check


def unit_quaternion(values: _Quaternion) -> _Quaternion:
    """A validator of rotations; a hand has rounded them."""
    if len(values) != 4:
        raise ValueError("must be four numbers w, x, y, z, as in [1, 0, 0, 0]")
    length = math.hypot(*values)
    if length == 0:
        raise ValueError("is no rotation: a quaternion's length must be 1, and its is 0")
    if abs(length - 1) > 0.01:
        raise ValueError(f"must have length 1, and its is {length:.4g}")
    return values


def check_lens(width: int, height: int, *, fx: float, fy: float, cx: float, cy: float) -> None:
    """Raises ValueError, which begins with the value's name, where no lens makes pictures of this size so."""
    for name, value, size, (low, high) in (
        ("fx", fx, width, FOCAL_LENGTHS),
        ("fy", fy, height, FOCAL_LENGTHS),
        ("cx", cx, width, CENTRES),
        ("cy", cy, height, CENTRES),
    ):
        if not low * size <= value <= high * size:
            wanted = f"must be {low * size:g} to {high * size:g} pixels for pictures of {width} × {height}"
            raise ValueError(f"{name}: {wanted}, not {value:g}")


def check_cycles_fit(waves_hz: Sequence[float], row_time_us: float) -> None:
    """Raises ValueError where no picture has as many rows as a cycle takes, from bright to bright again.

    Nothing tells such a wave's frequency, and what is searched for dark bands grows with their height.
    """
    least_hz = 1e6 / (MAX_SIDE_PX * row_time_us)
    if min(waves_hz) < least_hz:
        raise ValueError(
            f"{min(waves_hz):g} Hz is too slow: with a row every {row_time_us:g} µs must be at least "
            f"{math.ceil(least_hz)} Hz, or a cycle is higher than any picture"
        )


def _three_numbers(value: object) -> object:
    if isinstance(value, (list, tuple)) and len(value) == 3:
        return value
    raise ValueError("must be three numbers, as in [0, 0, 0]")


MountPosition = Annotated[tuple[MountM, MountM, MountM], BeforeValidator(_three_numbers)]
MapPosition = Annotated[tuple[PlaceM, PlaceM, PlaceM], BeforeValidator(_three_numbers)]
Angles = Annotated[tuple[Degrees, Degrees, Degrees], BeforeValidator(_three_numbers)]


class NoBooleans(BaseModel):
    """Values that a person has written: true is not taken for 1, and no name holds a character that no file's can."""

    @field_validator("*", mode="before")
    @classmethod
    def _is_no_boolean(cls, value: object, info: ValidationInfo) -> object:
        """YAML reads yes, no, on, off as booleans, and pydantic a boolean as the number 1 or 0."""
        if isinstance(value, bool) and cls.model_fields[str(info.field_name)].annotation is not bool:
            raise ValueError("takes no true or false (which YAML also reads from yes, no, on and off)")
        return value

    @field_validator("*", mode="before")
    @classmethod
    def _has_no_null(cls, value: object) -> object:
        if isinstance(value, str) and "\0" in value:
            raise ValueError("must hold no null character")
        return value


class Section(NoBooleans):
    """A section of the configuration: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _is_section(cls, value: object) -> object:
        if value is None:  # `camera:` with every key under it commented out
            return {}
        if isinstance(value, (dict, cls)):
            return value
        raise ValueError(f"must be a section with the keys {', '.join(sorted(cls.model_fields))}")
