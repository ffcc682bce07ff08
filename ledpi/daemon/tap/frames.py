"""Answers of the tap as the records of the path: for a client to decode or draw a frame once more."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ledpi.config.overrides import apply_override
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import Config, build_config, check_together
from ledpi.core.errors import ConfigError, TapError, raising
from ledpi.core.geometry import matrix_from_quaternion, transform
from ledpi.core.records import CameraInfo, Floats, Frame, Intrinsics, MapPanel, PanelMap
from ledpi.pipeline.diagnosis.diagnose import NotRead
from ledpi.pipeline.diagnosis.why_not import WhyNot

WITH_REASONS = ("rejected", "evidence")  # extras of a picture from which `not_read_of` knows all
SAME_PX = 1.0  # corners of one square, which are told twice, rounded


def camera_of(hello: dict[str, Any]) -> CameraInfo:
    """The daemon's camera. Raises TapError where the hello does not hold it."""
    camera = hello.get("camera", {})
    names = ("width", "height", "exposure_us", "row_time_us", "transfer", "frame_length_rows")
    with raising("the daemon's hello holds no whole camera", TapError, (KeyError, TypeError, ValueError)):
        values = {name: camera[name] for name in names}
        return CameraInfo(**values, rows_from=camera.get("rows_from", "above"), intrinsics=lens_told(camera))


def settings_of(hello: dict[str, Any], overrides: Sequence[str] = ()) -> Config:
    """The daemon's own settings, as far as decoding its pictures hangs on them, and `--set` overrides of them.

    A panel has the side that the map gives it. Raises TapError where they cannot be used here, as where its dictionary
    is a file that cannot be read; ConfigError for an override.
    """
    with raising(
        "the daemon's panels cannot be used here",
        TapError,
        (KeyError, TypeError, ValueError, AttributeError, ConfigError),
    ):
        raw: dict[str, Any] = {
            "panels": _panels_of(hello),
            "decode": _given(method=hello.get("method")),
            "robot": {"camera_mount": _given(**(hello.get("camera_mount") or {}))},
        }
        check_together(build_config(raw, "hello"), "hello")
    for item in overrides:
        apply_override(raw, item)
    settings = build_config(raw, "configuration")
    check_together(settings, "configuration")
    return settings


def _panels_of(hello: dict[str, Any]) -> dict[str, Any]:
    """The section `panels`, without the keys of a newer daemon."""
    panels = {key: value for key, value in hello["panels"].items() if key in PanelSettings.model_fields}
    overrides = {int(marker_id): dict(values) for marker_id, values in panels.get("overrides", {}).items()}
    for marker_id, panel in (hello.get("map") or {}).items():
        own = overrides.get(int(marker_id), {})
        if panel["side_m"] != (own.get("side_m") or panels["side_m"]):
            overrides[int(marker_id)] = own | {"side_m": panel["side_m"]}
    return panels | {"overrides": overrides}


def _given(**values: Any) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}


def why_not_of(hello: dict[str, Any]) -> WhyNot:
    """For the pictures of this daemon. Raises TapError."""
    camera = camera_of(hello)
    return WhyNot(camera, settings_of(hello).panels, camera.intrinsics)


def why_not_if_told(hello: dict[str, Any]) -> WhyNot | None:
    """The same; None where its panels cannot be looked for here, as with a dictionary that only the daemon may read."""
    try:
        return why_not_of(hello)
    except TapError:
        return None


def not_read_of(picture: dict[str, Any]) -> list[NotRead]:
    """Returns what was dropped in a picture that was asked for WITH_REASONS."""
    looks = [look for look in picture.get("looks", []) if look.get("why")]
    found = []
    for rejected in picture.get("rejected", []):
        corners = np.array(rejected["corners_px"], np.float64)
        look = next((x for x in looks if np.abs(np.array(x["corners_px"]) - corners).max() < SAME_PX), None)
        nats = None if look is None else _square(look.get("cells_nats") or [])
        found.append(NotRead(corners_px=corners, why=rejected["why"], cells_nats=nats, marker_id=rejected.get("id")))
    return found


def read_px_of(picture: dict[str, Any]) -> list[Floats]:
    """The corners (4, 2) of each panel that was read in it."""
    return [np.array(marker["corners_px"], np.float64) for marker in picture["decoded"]["markers"]]


def _square(numbers: list[float]) -> Floats | None:
    """(n, n); None where there are none, or not of a square."""
    side = math.isqrt(len(numbers))
    return np.array(numbers, np.float64).reshape(side, side) if side and side * side == len(numbers) else None


def frame_of(hello: dict[str, Any], picture: dict[str, Any]) -> Frame:
    """The frame of a picture's answer, with the camera's times. Raises TapError."""
    with raising("the daemon's picture holds no whole frame", TapError, (KeyError, TypeError, ValueError)):
        decoded = picture["decoded"]
        return Frame(
            pixels=picture["pixels"],
            seq=decoded["seq"],
            row0_readout_ns=decoded["sensor_timestamp_ns"],
            exposure_us=decoded["exposure_us"],
            row_time_us=hello["camera"]["row_time_us"],
            transfer=hello["camera"]["transfer"],
            analogue_gain=decoded["analogue_gain"],
        )


def lens_told(camera: dict[str, Any]) -> Intrinsics | None:
    """The lens of the hello's `camera`; None where the daemon has none. Raises KeyError, TypeError, ValueError."""
    if camera.get("fx") is None:
        return None
    values = {name: camera[name] for name in ("width", "height", "fx", "fy", "cx", "cy")}
    given = {name: camera[name] for name in ("distortion", "distortion_model") if camera.get(name) is not None}
    if "distortion" in given:
        given["distortion"] = tuple(given["distortion"])
    return Intrinsics(**values, **given)


def map_told(hello: dict[str, Any]) -> PanelMap | None:
    """The daemon's map; None where it has none. Raises KeyError, TypeError, ValueError."""
    if hello.get("map") is None:
        return None
    return {
        int(marker_id): MapPanel(
            map_from_marker=transform(
                matrix_from_quaternion(np.array(panel["quaternion_wxyz"])), np.array(panel["position_m"])
            ),
            side_m=panel["side_m"],
        )
        for marker_id, panel in hello["map"].items()
    }
