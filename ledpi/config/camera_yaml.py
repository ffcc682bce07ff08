"""camera.yaml: the lens, in the form of ROS camera_info: each side can read the other's files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import AfterValidator, BaseModel

from ledpi.config.mistakes import validated
from ledpi.config.values import Coefficient, Finite, SidePx, check_lens, numbers
from ledpi.core.errors import CalibrationError
from ledpi.core.files import read_yaml
from ledpi.core.records import CameraInfo, Intrinsics


def _camera_matrix(data: list[float]) -> list[float]:
    fx, skew, _, zero, fy, _, *last_row = numbers(9)(data)
    if fx > 0 and fy > 0 and skew == 0 and zero == 0 and last_row == [0, 0, 1]:
        return data
    raise ValueError("must be [fx, 0, cx, 0, fy, cy, 0, 0, 1] with positive fx and fy")


class _CameraMatrix(BaseModel):
    data: Annotated[list[Finite], AfterValidator(_camera_matrix)]


class _Coefficients(BaseModel):
    data: Annotated[list[Coefficient], AfterValidator(numbers(4, 5))]


class _CameraInfo(BaseModel):
    """What is read of a file; anything else in it is passed over."""

    image_width: SidePx
    image_height: SidePx
    camera_matrix: _CameraMatrix
    distortion_model: Literal["plumb_bob"] = "plumb_bob"  # ROS takes it for granted too where it is missing
    distortion_coefficients: _Coefficients


def load_intrinsics(path: Path, for_size: tuple[int, int] | None = None) -> Intrinsics:
    """Reads camera.yaml, ours or one made by ROS. Raises CalibrationError with file and key.

    The coefficients are OpenCV's k1 k2 p1 p2 and, where there is a fifth, k3. `for_size` is the
    (width, height) of the pictures that it is wanted for. A calibration at another size is refused: another
    sensor mode may show another part of the scene, and nothing tells how to convert.
    """
    raw = read_yaml(path, CalibrationError)
    if not isinstance(raw, dict):
        raise CalibrationError(f"{path}: must hold ROS camera_info (image_width, camera_matrix, …)")
    info = validated(_CameraInfo, raw, str(path), CalibrationError)
    size = (info.image_width, info.image_height)
    if for_size is not None and size != for_size:
        raise CalibrationError(
            f"{path}: was made for pictures of {size[0]} × {size[1]} pixels, but the camera delivers "
            f"{for_size[0]} × {for_size[1]}: calibrate at that size"
        )
    fx, _, cx, _, fy, cy, *_ = info.camera_matrix.data
    try:
        check_lens(*size, fx=fx, fy=fy, cx=cx, cy=cy)
    except ValueError as error:
        raise CalibrationError(f"{path}: camera_matrix.data: {error}") from None
    k1, k2, p1, p2, k3 = [*info.distortion_coefficients.data, 0.0][:5]
    return Intrinsics(
        width=info.image_width,
        height=info.image_height,
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        distortion=(k1, k2, p1, p2, k3),
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
    content: dict[str, Any] = {
        "image_width": intrinsics.width,
        "image_height": intrinsics.height,
        "camera_name": "ledpi",
        "camera_matrix": {"rows": 3, "cols": 3, "data": k},
        "distortion_model": "plumb_bob",
        "distortion_coefficients": {"rows": 1, "cols": 5, "data": [float(v) for v in intrinsics.distortion]},
        "rectification_matrix": {"rows": 3, "cols": 3, "data": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]},
        "projection_matrix": {"rows": 3, "cols": 4, "data": [*k[0:3], 0.0, *k[3:6], 0.0, *k[6:9], 0.0]},
        "ledpi": ledpi,
    }
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=110)
