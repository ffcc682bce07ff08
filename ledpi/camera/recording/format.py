"""Contents of a recording's files, value by value (format 1); recording.py checks them against each other.

Keys that are not known here are passed over, so that a recording may hold more than this version reads.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, Field, ValidationError, ValidationInfo, field_validator, model_validator
from typing_extensions import Self

from ledpi.config import values as values
from ledpi.core.dictionaries import is_file, load_dictionary
from ledpi.core.errors import RecordingError, raising, shortened, shortened_name
from ledpi.core.files import parse_json, read_text, read_yaml
from ledpi.core.records import COEFFICIENTS, DistortionModel, Phase, RowsFrom, Transfer

FORMAT = 1
HEADER_FILE, FRAMES_FILE, TRUTH_FILE = "recording.yaml", "frames.jsonl", "truth.jsonl"

_STRICT = Field(strict=True)  # no number is read from text
Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
Natural = Annotated[int, Field(strict=True, ge=0, lt=2**63)]
Size = Annotated[values.SidePx, _STRICT]
Rows = Annotated[int, Field(strict=True, ge=1, le=10_000_000)]  # of a frame: a second of the shortest rows, and more
Hertz = Annotated[values.Hertz, _STRICT]
Microseconds = Annotated[values.Microseconds, _STRICT]
RowTime = Annotated[values.RowTime, _STRICT]
SideM = Annotated[values.SideM, _STRICT]
Duty = Annotated[values.Duty, _STRICT]
Coefficient = Annotated[values.Coefficient, _STRICT]
Gain = Annotated[float, Field(strict=True, gt=0, le=1000)]
Point = tuple[Real, Real]
Model = TypeVar("Model", bound=BaseModel)
Made = TypeVar("Made")

# Of a .jsonl file: an hour of frames; a hundred panels of truth in a line. Read, it takes up to ten times its size.
MAX_LINES_BYTES, MAX_LINES, MAX_LINE = 24 * 1024 * 1024, 200_000, 64 * 1024

_log = logging.getLogger(__name__)


def _known_dictionary(name: str) -> str:
    if is_file(name):
        return _inside_the_folder(name)
    load_dictionary(name)
    return name


def _inside_the_folder(name: str) -> str:
    path = PurePosixPath(name)
    if not path.name or path.is_absolute() or ".." in path.parts or "\0" in name:
        raise ValueError("must be a path inside the recording, as frames/000000.png")
    return name


class CameraSection(BaseModel):
    """`camera` in recording.yaml."""

    width: Size
    height: Size
    row_time_us: RowTime
    exposure_us: Microseconds
    transfer: Transfer
    rows_from: RowsFrom = "above"
    frame_length_rows: Rows | None = None  # a V4L2 camera cannot tell
    fx: Positive | None = None  # fx to distortion: all, or none where the camera was not calibrated
    fy: Positive | None = None
    cx: Real | None = None
    cy: Real | None = None
    distortion_model: DistortionModel = "plumb_bob"
    distortion: tuple[Coefficient, ...] | None = None  # k1 k2 p1 p2 k3, or as many as the model has

    @field_validator("distortion")
    @classmethod
    def _is_of_its_model(cls, given: tuple[float, ...] | None, info: ValidationInfo) -> tuple[float, ...] | None:
        model = info.data.get("distortion_model")
        return given if given is None or model is None else values.numbers(len(COEFFICIENTS[model]))(given)


class PanelSection(BaseModel):
    """`panel` in recording.yaml: of every panel that the recording shows."""

    dictionary: Annotated[str, AfterValidator(_known_dictionary)]
    side_m: SideM
    black_hz: Hertz
    white_hz: Hertz
    duty: Duty
    phase: Phase = "free"


class Header(BaseModel):
    """recording.yaml, but for its format and what is not read."""

    camera: CameraSection
    panel: PanelSection
    wall_clock_offset_ns: Annotated[int, Field(strict=True, ge=-(2**63), lt=2**63)] | None = (
        None  # its times + this: Unix
    )


class FrameLine(BaseModel):
    """A line of frames.jsonl."""

    seq: Natural
    file: Annotated[str, AfterValidator(_inside_the_folder)]
    sensor_timestamp_ns: Natural
    exposure_us: Microseconds
    analogue_gain: Gain | None = None
    decoded: Annotated[bool | None, Field(strict=True)] = None  # while it was recorded; None: nothing was
    search_budget: Natural | None = None  # that the decoder had for it then (`pipeline`)


class TruthLineMarker(BaseModel):
    """A panel in a line of truth.jsonl. Of pictures that were put together only the corners are known."""

    id: Natural
    corners_px: tuple[Point, Point, Point, Point]
    position_m: tuple[Real, Real, Real] | None = None
    quaternion_wxyz: Annotated[tuple[Real, Real, Real, Real], AfterValidator(values.unit_quaternion)] | None = None
    optional: Annotated[bool, Field(strict=True)] = False

    @model_validator(mode="after")
    def _has_both_or_neither(self) -> Self:
        if (self.position_m is None) != (self.quaternion_wxyz is None):
            raise ValueError("position_m and quaternion_wxyz come together")
        return self


class TruthLine(BaseModel):
    """A line of truth.jsonl."""

    seq: Natural
    markers: tuple[TruthLineMarker, ...]


def read_header(path: Path) -> Header:
    """Reads recording.yaml. Raises RecordingError."""
    _require(path)
    raw = read_yaml(path, RecordingError)
    if not isinstance(raw, dict):
        wanted = "a mapping with format, camera and panel"
        raise RecordingError(f"{path}: must be {wanted}, not {type(raw).__name__}")
    if "format" not in raw:
        raise RecordingError(f"{path}: format: is missing; must be {FORMAT}")
    if type(raw["format"]) is not int or raw["format"] != FORMAT:
        found = shortened(raw["format"])
        raise RecordingError(f"{path}: format: is {found}; this version reads format {FORMAT}")
    return _resolve_dictionary_file(_checked(Header, raw, str(path)), path)


def _resolve_dictionary_file(header: Header, path: Path) -> Header:
    """A dictionary that comes with the recording, by its whole path."""
    if not is_file(header.panel.dictionary):
        return header
    dictionary = str((path.parent / header.panel.dictionary).absolute())
    with raising(f"{path}: panel.dictionary", RecordingError):
        load_dictionary(dictionary)
    return header.model_copy(update={"panel": header.panel.model_copy(update={"dictionary": dictionary})})


def read_lines(path: Path, model: type[Model], made: Callable[[Model], Made]) -> tuple[list[tuple[int, Made]], bool]:
    """The lines of a .jsonl file, numbered from 1, without empty ones; and whether its end is missing.

    What is kept of a line is what is `made` of it: that takes less memory.

    Its end is missing where the power failed: of the last line there is a part then, and no line break. That part is
    left out with a warning, if a whole line comes before it. Raises RecordingError for any other broken line.
    """
    _require(path)
    lines: list[tuple[int, Made]] = []
    for number, text in enumerate(_split(read_text(path, RecordingError, MAX_LINES_BYTES)), start=1):
        if number > MAX_LINES:
            raise RecordingError(f"{path}: has too many lines; must be at most {MAX_LINES:,}")
        if not text.strip():
            continue
        where = f"{path}: line {number}"
        if len(text) > MAX_LINE:
            raise RecordingError(f"{where}: is too long; must be at most {MAX_LINE:,} characters")
        try:
            raw = parse_json(text)
        except ValueError as error:
            if lines and not text.endswith("\n"):
                _log.warning("%s: is cut off; it is left out, what stands before it is read", where)
                return lines, True
            raise RecordingError(f"{where}: not valid JSON ({error}); must be one object a line") from None
        if not isinstance(raw, dict):
            raise RecordingError(f"{where}: must be a JSON object, not {type(raw).__name__}")
        lines.append((number, made(_checked(model, raw, where))))
    return lines, False


def _split(text: str) -> Iterator[str]:
    """One by one, each with its line break: all together they may take fifty times the text's own memory."""
    start = 0
    while start < len(text):
        end = text.find("\n", start) + 1 or len(text)
        yield text[start:end]
        start = end


def _require(path: Path) -> None:
    if not path.exists():
        wanted = f"a recording has {HEADER_FILE}, {FRAMES_FILE} and its pictures"
        raise RecordingError(f"{path}: is missing; {wanted}")


def _checked(model: type[Model], raw: dict[str, Any], where: str) -> Model:
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(shortened_name(part) for part in first["loc"])
        if first["type"] == "missing":
            raise RecordingError(f"{where}: {key}: is missing; must be given") from None
        message = first["msg"].removeprefix("Value error, ").replace("Input should be", "must be")
        raise RecordingError(f"{where}: {key}: {message}, not {shortened(first['input'])}") from None
