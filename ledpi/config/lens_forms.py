"""A lens's file, in any of the forms that calibration tools write, as the keys and values of ROS camera_info.

ROS: camera_info as YAML, as .ini and as a topic's echo. OpenCV: FileStorage as YAML or XML. Kalibr: a camchain of one
camera. PhotonVision: its JSON. They differ in how keys are spelt, how a matrix is nested, and in the name of the model.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

from ledpi.core.errors import CalibrationError, raising, shortened
from ledpi.core.files import MAX_TEXT_BYTES, parse_json, parse_yaml, read_text
from ledpi.core.records import COEFFICIENTS, DistortionModel

MAX_JSON_BYTES = 64 * 1024 * 1024  # PhotonVision's holds every corner of every picture
EXPECTED = (
    "must hold a lens: ROS camera_info (image_width, camera_matrix, …), or the file of OpenCV, Kalibr or PhotonVision"
)

# Keys as tools spell them, in small letters without _ and -; what ROS calls it.
_KEYS = {
    "image_width": ("imagewidth", "width"),
    "image_height": ("imageheight", "height"),
    "camera_matrix": ("cameramatrix", "cameraintrinsics", "intrinsicmatrix", "intrinsics", "k", "m", "mtx"),
    "distortion_coefficients": (
        *("distortioncoefficients", "distortioncoeffs", "distcoeffs", "distcoeff", "distortion", "dist", "d"),
    ),
}
_SIZES = ("resolution", "imagesize")  # [width, height], or {width, height}
_MODEL_KEYS = ("distortionmodel", "cameramodel", "lensmodel", "fisheyemodel", "model")
# By the same spelling. None: says nothing of the distortion.
_MODELS: Mapping[str, DistortionModel | None] = {
    **dict.fromkeys(("pinhole", "opencv", "lensmodelopencv", "none", ""), None),
    **dict.fromkeys(("plumbbob", "radtan", "radialtangential", "brownconrady", "0", "false"), "plumb_bob"),
    **dict.fromkeys(("rationalpolynomial", "rational", "thinprism"), "plumb_bob"),  # by their number of coefficients
    **dict.fromkeys(("lensmodelopencv4", "lensmodelopencv5", "lensmodelopencv8", "lensmodelopencv12"), "plumb_bob"),
    **dict.fromkeys(("equidistant", "equi", "fisheye", "kannalabrandt", "kannalabrandt4", "1", "true"), "equidistant"),
}
KNOWN_MODELS = "plumb_bob (radtan), rational_polynomial, thin_prism or equidistant (fisheye)"
_PERSPECTIVE: tuple[DistortionModel, ...] = ("plumb_bob", "rational_polynomial", "thin_prism")
_COUNTS = (0, 4, 5, 8, 12, 14)  # of OpenCV's coefficients; the last two are of a tilted sensor


class LensForm(NamedTuple):
    """The contents of a file, by ROS's keys."""

    values: dict[str, Any]  # image_width, image_height, camera_matrix, distortion_coefficients: numbers, not checked
    names: dict[str, str]  # how the file calls each of them
    model: DistortionModel | None  # None: it does not say


def read_lens_form(path: Path) -> LensForm:
    """Reads a file. Raises CalibrationError where it cannot be read, or holds no lens or more than one."""
    text = read_text(path, CalibrationError, MAX_JSON_BYTES)
    content = _one_camera(_parsed(text, path), path)
    own = {_spelling(key): key for key in reversed(content)}
    values: dict[str, Any] = {}
    names: dict[str, str] = {}
    for key, spellings in _KEYS.items():
        found = next((spelling for spelling in spellings if spelling in own), None)
        if found is not None:
            names[key] = str(own[found])
            values[key] = content[own[found]]
    model = _model({own[key]: content[own[key]] for key in _MODEL_KEYS if key in own}, path)
    if "camera_matrix" not in names:
        raise CalibrationError(f"{path}: {EXPECTED}")
    for size in (content[own[key]] for key in _SIZES if key in own):
        values = {**dict(zip(("image_width", "image_height"), _size(size), strict=True)), **values}
    values["camera_matrix"] = _matrix(values["camera_matrix"])
    if "distortion_coefficients" not in names:  # they may be there by a name that is not known
        raise CalibrationError(
            f"{path}: distortion_coefficients: must be given, by that name; [0, 0, 0, 0, 0] for a lens without any"
        )
    values["distortion_coefficients"] = _flat(values["distortion_coefficients"])
    return LensForm(values, names, model)


def lens_form(values: dict[str, Any], names: dict[str, str], model: str, where: object) -> LensForm:
    """The form of values by ROS's keys. Raises CalibrationError for a model that is not known."""
    return LensForm(values, names, _model({"distortion_model": model}, where))


def of_model(model: DistortionModel | None, values: Sequence[float]) -> tuple[DistortionModel, tuple[float, ...]]:
    """The model with its coefficients, of as many as are given: zeros behind them do not matter.

    Raises ValueError that says what would be right. Four coefficients alone may be k1 k2 p1 p2, or a fisheye's k1 to
    k4: the one read as the other is degrees off, so they need the model's name.
    """
    used = max((place for place, value in enumerate(values, start=1) if value != 0), default=0)
    if model == "equidistant":
        if len(values) < 4 or used > 4:
            raise ValueError(f"must be 4 numbers, k1 k2 k3 k4, for an equidistant lens, not {len(values)}")
        return model, tuple(values[:4])
    if len(values) not in _COUNTS:
        raise ValueError("must be 4, 5, 8 or 12 numbers: k1 k2 p1 p2 (k3 (k4 k5 k6 (s1 s2 s3 s4)))")
    if model is None and len(values) == 4 and used:
        raise ValueError(
            "are 4 numbers without the model's name: must have the model plumb_bob for k1 k2 p1 p2, or equidistant "
            "for a fisheye's k1 k2 k3 k4"
        )
    if used > 12:
        raise ValueError("must be 12 numbers at most, not those of a tilted sensor (τx, τy)")
    smallest = next(name for name in _PERSPECTIVE if used <= len(COEFFICIENTS[name]))
    count = len(COEFFICIENTS[smallest])
    return smallest, (*values, *(0.0,) * count)[:count]


def _parsed(text: str, path: Path) -> Any:
    start = text.lstrip()[:20]
    if start.startswith("{"):
        with raising(f"{path}: not valid JSON", CalibrationError):
            return parse_json(text)
    if len(text) > MAX_TEXT_BYTES:
        raise CalibrationError(f"{path}: is too large to be read; must be at most {MAX_TEXT_BYTES:,} characters")
    if start.startswith("<"):
        return _xml(text, path)
    if re.search(r"^\[image\]\s*$", text, re.MULTILINE):
        return _ini(text)
    # OpenCV begins with a directive that no other reader knows; an echo goes on with further messages.
    plain = re.sub(r"^%YAML.*$|!!opencv-(nd-)?matrix", "", text, flags=re.MULTILINE)
    parts = [part for part in re.split(r"^---[ \t]*$", plain, flags=re.MULTILINE) if part.strip()]
    return parse_yaml(parts[0] if parts else "", path, CalibrationError)


def _xml(text: str, path: Path) -> dict[str, Any]:
    """OpenCV's FileStorage."""
    if "<!" in re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL):
        raise CalibrationError(f"{path}: its XML declares something; must be OpenCV's FileStorage, as it is written")
    with raising(f"{path}: not valid XML", CalibrationError, ElementTree.ParseError):
        root = ElementTree.fromstring(text)
    return {node.tag: _numbers(node.findtext("data") or node.text or "") for node in root}


def _ini(text: str) -> dict[str, Any]:
    """ROS's own: a name on a line, its numbers on the next ones."""
    lines: dict[str, list[str]] = {}
    name = ""
    for line in (line.strip() for line in text.splitlines()):
        if not line or line[0] in "#[":
            name = ""
        elif re.match(r"[A-Za-z]", line):
            name = line.replace(" ", "_")
            lines[name] = []
        elif name:
            lines[name].append(line)
    return {name: _numbers(" ".join(numbers)) for name, numbers in lines.items()}


def _numbers(text: str) -> Any:
    """A number, a list of numbers, or the text."""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return text.strip().strip('"')
    return values if len(values) > 1 else values[0] if values else ""


def _one_camera(content: Any, path: Path) -> Mapping[Any, Any]:
    """The mapping that holds a camera matrix: all of it, or of Kalibr's `cam0`, …, the only one."""
    if not isinstance(content, dict):
        raise CalibrationError(f"{path}: {EXPECTED}")
    if _has_matrix(content):
        return content
    inside = {name: part for name, part in content.items() if isinstance(part, dict) and _has_matrix(part)}
    if len(inside) > 1:
        raise CalibrationError(f"{path}: holds several cameras ({', '.join(map(str, inside))}); must hold one")
    return next(iter(inside.values()), content)


def _has_matrix(content: Mapping[Any, Any]) -> bool:
    return any(_spelling(key) in _KEYS["camera_matrix"] for key in content)


def _spelling(text: object) -> str:
    return re.sub(r"[\s_-]", "", str(text)).lower()


def _size(size: Any) -> list[Any]:
    """Width and height, of [width, height] or of a mapping; of anything else, nothing."""
    if isinstance(size, dict):
        size = [size.get("width"), size.get("height")] if "width" in size else _flat(size)
    return size if isinstance(size, list) and len(size) == 2 else [None, None]


def _flat(value: Any) -> Any:
    """A matrix's numbers, however it is nested."""
    if isinstance(value, dict) and "data" in value:
        value = value["data"]
    if isinstance(value, list):  # some write them without commas, which is one text to YAML
        value = [_numbers(part) if isinstance(part, str) else part for part in value]
    if isinstance(value, list) and any(isinstance(part, list) for part in value):
        return [number for part in value for number in (part if isinstance(part, list) else [part])]
    return [] if value in ("", None) else value


def _matrix(value: Any) -> Any:
    """Nine numbers; Kalibr gives fx fy cx cy."""
    numbers = _flat(value) if value is not None else None
    if isinstance(numbers, list) and len(numbers) == 4:
        fx, fy, cx, cy = numbers
        return [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    return numbers


def _model(given: Mapping[str, Any], path: object) -> DistortionModel | None:
    found: dict[DistortionModel, str] = {}
    for key, value in given.items():
        number = isinstance(value, float) and value.is_integer()
        spelling = _spelling(int(value) if number else "" if value is None else value)
        if spelling not in _MODELS:
            raise CalibrationError(f"{path}: {key}: {shortened(value)} is not known; must be {KNOWN_MODELS}")
        model = _MODELS[spelling]
        if model is not None:
            found.setdefault(model, f"{key}: {value}")
    if len(found) > 1:
        raise CalibrationError(f"{path}: contradicts itself: {', '.join(found.values())}")
    return next(iter(found), None)
