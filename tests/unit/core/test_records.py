"""Records are valid once built, and stay so."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest

from ledpi.core.records import Frame, Intrinsics, PanelSpec, read_only
from ledpi.core.shutter import row_mid_exposure_ns


def frame(**changes: Any) -> Frame:
    values: dict[str, Any] = {
        "pixels": np.zeros((4, 6), np.uint8),
        "seq": 3,
        "row0_readout_ns": 0,
        "exposure_us": 10000.0,
        "row_time_us": 33.67,
        "transfer": "linear",
    }
    return Frame(**(values | changes))


def intrinsics(**changes: Any) -> Intrinsics:
    values = {"width": 640, "height": 480, "fx": 600.0, "fy": 601.0, "cx": 320.0, "cy": 240.0}
    return Intrinsics(**(values | changes))


def test_a_frame_cannot_be_changed() -> None:
    """Neither a field of a frame nor a pixel can be assigned to."""
    one = frame()
    with pytest.raises(FrozenInstanceError):
        one.seq = 4  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        one.pixels[0, 0] = 1


def test_a_part_of_another_picture_is_copied() -> None:
    """Loops in C go from row to row without gaps; a whole picture stays where it is."""
    whole = np.arange(48, dtype=np.uint8).reshape(6, 8)
    part = frame(pixels=whole[1:5, ::2])
    assert part.pixels.flags.c_contiguous
    np.testing.assert_array_equal(part.pixels, whole[1:5, ::2])
    assert frame(pixels=whole.view()).pixels.ctypes.data == whole.ctypes.data


def test_a_turned_frame_s_last_row_was_read_out_first() -> None:
    """Gives each row of a picture that was turned by 180° the time at which the sensor read it."""
    upright = frame()
    turned, last = upright.turned(), upright.pixels.shape[0] - 1
    for row in (0, 1, last):
        assert row_mid_exposure_ns(turned, row) == pytest.approx(row_mid_exposure_ns(upright, last - row), abs=1)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"pixels": np.zeros((4, 6, 3), np.uint8)}, r"must be \(H, W\) uint8, not \(4, 6, 3\)"),
        ({"pixels": np.zeros((4, 6), np.float32)}, r"must be \(H, W\) uint8, not \(4, 6\) float32"),
        ({"exposure_us": 0.0}, "exposure_us must be positive, and row_time_us not zero"),
        ({"row_time_us": 0.0}, "exposure_us must be positive, and row_time_us not zero"),
        ({"exposure_us": float("nan")}, "exposure_us must be positive, and row_time_us not zero"),
    ],
)
def test_a_bad_frame_is_refused(changes: dict[str, Any], expected: str) -> None:
    """Colour, other number types, and times that are not positive are errors when the frame is built."""
    with pytest.raises(ValueError, match=expected):
        frame(**changes)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"side_m": 0.0}, "side_m must be positive, not 0"),
        ({"side_m": float("nan")}, "side_m must be positive, not nan"),
        ({"black_hz": -1250.0}, "black_hz and white_hz must be positive"),
        ({"white_hz": 1250.0}, "black_hz and white_hz must differ, both are 1250"),
        ({"duty": 1.0}, "duty must lie between 0 and 1, not 1"),
    ],
)
def test_a_bad_panel_is_refused(changes: dict[str, float], expected: str) -> None:
    """A panel without size, without blinking, or with one class only is an error when it is built."""
    values = {"side_m": 0.16, "black_hz": 1250.0, "white_hz": 2450.0}
    with pytest.raises(ValueError, match=expected):
        PanelSpec(**(values | changes))


@pytest.mark.parametrize(
    "changes", [{"fx": 0.0}, {"fy": -1.0}, {"cx": float("nan")}, {"distortion": (float("inf"), 0, 0, 0, 0)}]
)
def test_bad_intrinsics_are_refused(changes: dict[str, Any]) -> None:
    """A focal length that is not positive and a value that is not finite are errors."""
    with pytest.raises(ValueError, match="intrinsics: fx and fy must be positive and every value finite"):
        intrinsics(**changes)


def test_read_only_leaves_the_callers_array() -> None:
    """The view cannot be written to, the array it was made of can, and shows through."""
    array = np.zeros(3)
    view = read_only(array)
    with pytest.raises(ValueError, match="read-only"):
        view[0] = 1
    array[0] = 2
    assert view[0] == 2
