"""Values that people write into configurations, maps and recordings: their types, and limits that catch slips."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, Discriminator, Field, Tag, ValidationInfo, field_validator

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
# What lies outside these was given in another unit: kilohertz, seconds, nanoseconds.
Hertz = Annotated[float, Field(ge=10, le=1_000_000, allow_inf_nan=False)]
Microseconds = Annotated[float, Field(ge=1, le=10_000_000, allow_inf_nan=False)]
RowTime = Annotated[float, Field(ge=1, le=1_000, allow_inf_nan=False)]  # µs; sensors' rows take 5 to 100
SideM = Annotated[float, Field(gt=0, le=10, allow_inf_nan=False)]  # a larger one was given in millimetres
Finite = Annotated[float, Field(allow_inf_nan=False)]
Duty = Annotated[float, Field(gt=0, lt=1)]
Gain = Annotated[float, Field(ge=1, le=64)]
_Auto = Annotated[Literal["auto"], Tag("auto")]
# Only the branch that was meant is tried, so that a wrong number gives one message and not one a branch.
_number_or_auto = Discriminator(lambda value: "auto" if value == "auto" else "number")
RowTimeOrAuto = Annotated[Annotated[RowTime, Tag("number")] | _Auto, _number_or_auto]
MicrosecondsOrAuto = Annotated[Annotated[Microseconds, Tag("number")] | _Auto, _number_or_auto]
GainOrAuto = Annotated[Annotated[Gain, Tag("number")] | _Auto, _number_or_auto]


def _three_numbers(value: object) -> object:
    if isinstance(value, (list, tuple)) and len(value) == 3:
        return value
    raise ValueError("must be three numbers, as in [0, 0, 0]")


Vector3 = Annotated[tuple[Finite, Finite, Finite], BeforeValidator(_three_numbers)]


class NoBooleans(BaseModel):
    """What a person has written, where true is not taken for 1, and no name holds a character that no file's can."""

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
