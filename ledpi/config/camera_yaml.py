"""camera.yaml: the lens, written in the form of ROS camera_info, and read in that and other tools' forms."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import AfterValidator, BaseModel, ValidationError

from ledpi.config.lens_forms import LensForm, of_model, read_lens_form
from ledpi.config.mistakes import explain
from ledpi.config.values import Coefficient, Finite, SidePx, check_lens, numbers
from ledpi.core.errors import CalibrationError, raising
from ledpi.core.files import read_yaml
from ledpi.core.lens import WIDEST_DEG, blind_part, is_widest
from ledpi.core.records import CameraInfo, Intrinsics

_log = logging.getLogger(__name__)


def _camera_matrix(data: list[float]) -> list[float]:
    fx, skew, _, zero, fy, _, *last_row = numbers(9)(data)
    if fx > 0 and fy > 0 and skew == 0 and zero == 0 and last_row == [0, 0, 1]:
        return data
    raise ValueError("must be [fx, 0, cx, 0, fy, cy, 0, 0, 1] with positive fx and fy")


class _CameraInfo(BaseModel):
    """The keys that are read of a file; anything else in it is passed over."""

    image_width: SidePx
    image_height: SidePx
    camera_matrix: Annotated[list[Finite], AfterValidator(_camera_matrix)]
    distortion_coefficients: list[Coefficient]


def load_intrinsics(path: Path, for_size: tuple[int, int] | None = None) -> Intrinsics:
    """Reads camera.yaml, ours or one of those that `lens_forms` knows. Raises CalibrationError with file and key.

    `for_size` is the (width, height) of the pictures that it is wanted for. A calibration at another size is refused:
    another sensor mode may show another part of the scene, and nothing tells how to convert. Warns where the lens
    shows several directions at one pixel.
    """
    form = read_lens_form(path)
    try:
        lens = lens_of_form(form)
    except CalibrationError as error:
        key, colon, rest = str(error).partition(":")
        name, dot, place = key.partition(".")
        raise CalibrationError(f"{path}: {form.names.get(name, name)}{dot}{place}{colon}{rest}") from None
    size = (lens.width, lens.height)
    if for_size is not None and size != for_size:
        raise CalibrationError(
            f"{path}: was made for pictures of {size[0]} × {size[1]} pixels, but the camera delivers "
            f"{for_size[0]} × {for_size[1]}: calibrate at that size"
        )
    note = blind_note(lens)
    if note is not None:
        _log.warning("%s: %s", path, note)
    return lens


def lens_of_form(form: LensForm) -> Intrinsics:
    """The lens that a form holds. Raises CalibrationError, which begins with the key."""
    try:
        info = _CameraInfo.model_validate(form.values)
    except ValidationError as error:
        raise CalibrationError(explain(error, _CameraInfo)) from None
    fx, _, cx, _, fy, cy, *_ = info.camera_matrix
    with raising("camera_matrix", CalibrationError):
        check_lens(info.image_width, info.image_height, fx=fx, fy=fy, cx=cx, cy=cy)
    with raising("distortion_coefficients", CalibrationError):
        model, distortion = of_model(form.model, info.distortion_coefficients)
    return Intrinsics(
        width=info.image_width,
        height=info.image_height,
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        distortion=distortion,
        distortion_model=model,
    )


def blind_note(lens: Intrinsics) -> str | None:
    """Says that a lens does not give each pixel a direction of its own; None where it does."""
    share, from_px = blind_part(lens)
    if not share:
        return None
    why = (
        f"it sees further than {WIDEST_DEG:.0f}° aside"
        if is_widest(lens)
        else "its distortion folds within the picture"
    )
    return (
        f"{why}: from {from_px:.0f} px off its middle on, {max(1, round(100 * share))}% of the picture, pixels have no "
        "direction, and panels are not read"
    )


def lens_of(camera: CameraInfo, path: Path | None) -> Intrinsics | None:
    """The source's own lens, else the one of `camera.intrinsics`. Raises CalibrationError."""
    if camera.intrinsics is not None or path is None:
        return camera.intrinsics
    return load_intrinsics(path, (camera.width, camera.height))


def own_section(path: Path) -> dict[str, Any]:
    """The section `ledpi` of a camera.yaml: how good it is, and what is known of the shutter. Empty without one."""
    try:
        raw = read_yaml(path, CalibrationError)
    except CalibrationError:
        return {}
    section = raw.get("ledpi") if isinstance(raw, dict) else None
    return section if isinstance(section, dict) else {}


def camera_yaml_text(intrinsics: Intrinsics, ledpi: dict[str, Any]) -> str:
    """The text of a camera.yaml. `ledpi` is our own section, which ROS passes over: how good it is."""
    k = [float(value) for value in intrinsics.matrix().ravel()]
    bent = [float(value) for value in intrinsics.distortion]
    content: dict[str, Any] = {
        "image_width": intrinsics.width,
        "image_height": intrinsics.height,
        "camera_name": "ledpi",
        "camera_matrix": {"rows": 3, "cols": 3, "data": k},
        "distortion_model": intrinsics.distortion_model,
        "distortion_coefficients": {"rows": 1, "cols": len(bent), "data": bent},
        "rectification_matrix": {"rows": 3, "cols": 3, "data": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]},
        "projection_matrix": {"rows": 3, "cols": 4, "data": [*k[0:3], 0.0, *k[3:6], 0.0, *k[6:9], 0.0]},
        "ledpi": ledpi,
    }
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=110)
