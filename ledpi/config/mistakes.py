"""Mistakes in a configuration, each in one line and in the configuration's own words."""

from __future__ import annotations

import difflib
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from ledpi.core.errors import LedpiError, shortened, shortened_name

# Where pydantic's words say more about Python than about the key.
_WORDING = {
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "int_type": "must be a whole number",
    "int_parsing": "must be a whole number",
    "int_from_float": "must be a whole number",
    "string_type": "must be text",
    "string_pattern_mismatch": "must be letters, digits and any of . _ ~ + / = -",
    "path_type": "must be a path",
    "bool_type": "must be true or false",
    "list_type": "must be a list",
    "tuple_type": "must be a list, as in [7, 23]",
    "too_short": "must not be empty",
    "date_parsing": "must be a date, as in 2026-11-25",
    "date_from_datetime_parsing": "must be a date, as in 2026-11-25",
    "model_type": "must be a section",
    "dict_type": "must be a mapping from IDs, as in {7: {side_m: 0.3}}",
}

M = TypeVar("M", bound=BaseModel)
_UNKNOWN = ("extra_forbidden", "invalid_key")

SECRET = "token"  # how the last word of a key ends whose value nobody is shown

# Last parts of a location that are no keys: the branch of a number or `auto`, and [key] for a mapping's key.
_BRANCHES = ("number", "auto", "[key]")


def validated(model: type[M], raw: Any, where: str, error_type: type[LedpiError], more: str = "more") -> M:
    """The values as this model. Raises `error_type`, one line for the first mistake; `more` names the further ones."""
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        raise error_type(f"{where}: {explain(error, model, more)}") from None


def explain(error: ValidationError, model: type[BaseModel], more: str = "more") -> str:
    """One line for the first thing that is wrong in a `model`, with the number of the others."""
    first, *others = explain_all(error, model)
    return first + (f" (and {len(others)} {more})" if others else "")


def explain_all(error: ValidationError, model: type[BaseModel]) -> list[str]:
    """A line for each thing that is wrong in a `model`."""
    # A misspelt key leaves the right one missing: it is the cause, and comes first.
    problems = sorted(error.errors(), key=lambda problem: problem["type"] not in _UNKNOWN)
    return [_explained(problem, model) for problem in problems]


def _explained(problem: ErrorDetails, model: type[BaseModel]) -> str:
    location = problem["loc"]
    unknown = problem["type"] in _UNKNOWN
    branch = location[-1] if not unknown and location[-1] in _BRANCHES else None
    key = ".".join(shortened_name(part) for part in (location if branch is None else location[:-1]))
    if unknown:
        allowed = sorted(_section_at(model, location[:-1]).model_fields)
        close = difflib.get_close_matches(shortened_name(location[-1]), allowed, n=1)
        hint = f"did you mean {close[0]}? " if close else ""
        text = f"{key}: unknown key; {hint}allowed here: {', '.join(allowed)}"
    elif problem["type"] == "missing":
        text = f"{key}: must be given (it has no default)"
    else:
        auto, given = " or auto" if branch == "number" else "", problem["input"]
        text = f"{key}: {_wording(problem)}{auto}"
        if not key.endswith(SECRET):
            text += f", not {'null' if given is None else shortened(given)}"
    return text


def _wording(problem: ErrorDetails) -> str:
    if problem["type"] == "string_too_short":
        least = problem["ctx"]["min_length"]
        return "must not be empty" if least == 1 else f"is too short: must have {least} characters or more"
    message = problem["msg"].removeprefix("Value error, ").replace("Input should be", "must be")
    return _WORDING.get(problem["type"], message)


def _section_at(model: type[BaseModel], location: tuple[int | str, ...]) -> type[BaseModel]:
    node: Any = model
    for part in location:
        if isinstance(node, type) and issubclass(node, BaseModel):
            node = node.model_fields[str(part)].annotation
            if type(None) in get_args(node):  # section | None
                node = get_args(node)[0]
        else:
            node = get_args(node)[-1]  # dict[ID, section]
    return node  # type: ignore[no-any-return]
