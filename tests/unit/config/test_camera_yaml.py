"""camera.yaml: a file of ROS is read, ours comes back as it was, and a broken one names its key."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from ledpi.config.camera_yaml import camera_yaml_text, load_intrinsics
from ledpi.core.errors import CalibrationError
from ledpi.core.records import Intrinsics
from tests.builders.lenses import PUBLIC

# As ROS' camera_calibration_parsers writes it (YAML 1.2, where 1e-05 is a number).
MADE_BY_ROS = """\
image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [605.5, 0, 322.25, 0, 606.5, 238.75, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.125, -0.25, 1e-05, -0.0005, 0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [610, 0, 322, 0, 0, 611, 238, 0, 0, 0, 1, 0]
"""

COEFFICIENTS = (0.125, -0.25, 1e-5, -0.0005, 0.0)
LENS = Intrinsics(width=640, height=480, fx=605.5, fy=606.5, cx=322.25, cy=238.75, distortion=COEFFICIENTS)


def written(folder: Path, text: str) -> Path:
    path = folder / "camera.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def message(path: Path) -> str:
    with pytest.raises(CalibrationError) as caught:
        load_intrinsics(path)
    return str(caught.value)


def test_a_file_of_ros_is_read(tmp_path: Path) -> None:
    """Size, matrix and coefficients are those of the file; the rest of it is passed over."""
    assert load_intrinsics(written(tmp_path, MADE_BY_ROS)) == LENS


def test_four_coefficients_are_enough(tmp_path: Path) -> None:
    """k3 is 0 where a file has k1 k2 p1 p2 only."""
    assert load_intrinsics(written(tmp_path, MADE_BY_ROS.replace("-0.0005, 0]", "-0.0005]"))) == LENS


def test_five_coefficients_need_no_name(tmp_path: Path) -> None:
    """No other model has five: the model's name may be missing, as ROS takes plumb_bob for granted."""
    assert load_intrinsics(written(tmp_path, MADE_BY_ROS.replace("distortion_model: plumb_bob\n", ""))) == LENS


@pytest.mark.parametrize("name", PUBLIC)
def test_every_model_comes_back(tmp_path: Path, name: str) -> None:
    """A lens of any model is written and read without a loss."""
    assert load_intrinsics(written(tmp_path, camera_yaml_text(PUBLIC[name], {}))) == PUBLIC[name]


def test_what_is_written_comes_back(tmp_path: Path) -> None:
    """Values survive to the last bit, also those that are awkward in YAML."""
    lens = Intrinsics(
        width=640, height=480, fx=1000 / 3, fy=500, cx=1e-7, cy=-0.1, distortion=(1e-22, 1e-300, -1e-5, 0.1, 3)
    )
    assert load_intrinsics(written(tmp_path, camera_yaml_text(lens, {"rms_px": 0.1}))) == lens


def test_what_is_written_has_the_keys_of_ros() -> None:
    """The same keys and shapes as a file of ROS, no rectification, and our own section after them."""
    ours = yaml.safe_load(camera_yaml_text(LENS, {"rms_px": 0.114, "views": 18}))
    ros = yaml.safe_load(MADE_BY_ROS)
    assert list(ours) == [*ros, "ledpi"]
    for key in ("camera_matrix", "distortion_coefficients", "rectification_matrix", "projection_matrix"):
        assert (ours[key]["rows"], ours[key]["cols"]) == (ros[key]["rows"], ros[key]["cols"])
        assert len(ours[key]["data"]) == len(ros[key]["data"])
    assert ours["projection_matrix"]["data"] == [605.5, 0, 322.25, 0, 0, 606.5, 238.75, 0, 0, 0, 1, 0]
    assert ours["ledpi"] == {"rms_px": 0.114, "views": 18}


def test_a_file_for_another_size_is_refused(tmp_path: Path) -> None:
    """A lens that was measured at 640 × 480 says nothing of another mode's pictures."""
    path = written(tmp_path, MADE_BY_ROS)
    assert load_intrinsics(path, for_size=(640, 480)) == LENS
    with pytest.raises(CalibrationError, match=r"made for pictures of 640 × 480 pixels, .* 1296 × 972"):
        load_intrinsics(path, for_size=(1296, 972))


@pytest.mark.parametrize(
    ("right", "wrong", "expected"),
    [
        ("image_width: 640", "image_width: wide", "image_width: must be a whole number, not 'wide'"),
        ("image_width: 640\n", "", "image_width: must be given"),
        ("image_height: 480", "image_height: 0", "image_height: must be greater than or equal to 1, not 0"),
        ("plumb_bob", "fov", "distortion_model: 'fov' is not known; must be plumb_bob (radtan), rational_polynomial, "),
        ("distortion_model: plumb_bob", "camera_model: omni", "camera_model: 'omni' is not known; must be plumb_bob"),
        ("plumb_bob", "plumb_bob\ncamera_model: fisheye", "contradicts itself: distortion_model: plumb_bob, camera_mo"),
        ("-0.0005, 0]", "]", "distortion_coefficients: must be 4, 5, 8 or 12 numbers"),
        ("data: [0.125", "data: [.nan", "distortion_coefficients.0: must be a finite number, not nan"),
        ("238.75, 0, 0, 1]", "238.75]", "camera_matrix: must be 9 numbers"),
        ("[605.5, 0,", "[605.5, 2,", "camera_matrix: must be [fx, 0, cx, 0, fy, cy, 0, 0, 1]"),
        ("[605.5, 0,", "[0, 0,", "camera_matrix: must be [fx, 0, cx, 0, fy, cy, 0, 0, 1]"),
        ("[605.5, 0,", "[3.6, 0,", "camera_matrix: fx: must be 64 to 64000 pixels for pictures of 640 × 480"),
        ("322.25", "-2000", "camera_matrix: cx: must be -640 to 1280 pixels for pictures of 640 × 480, not -2000"),
        ("camera_matrix:\n", "camera_matrix: 3\nother:\n", "camera_matrix: must be a list, not 3"),
        ("  cols: 5", "  cols: [5", "not valid YAML"),
    ],
)
def test_a_broken_file_names_its_key(tmp_path: Path, right: str, wrong: str, expected: str) -> None:
    """Each kind of damage gives one line with file, key, and what is right."""
    assert right in MADE_BY_ROS
    path = written(tmp_path, MADE_BY_ROS.replace(right, wrong, 1))
    text = message(path)
    assert text.startswith(f"{path}: ")
    assert expected in text
    assert "\n" not in text


def test_a_file_that_is_none_is_named(tmp_path: Path) -> None:
    """A file that is not there, not text, or not of this kind gives one line with its name."""
    path = tmp_path / "camera.yaml"
    assert message(path) == f"{path}: cannot be read: No such file or directory"
    path.write_bytes(b"\xff\xfe")
    assert message(path) == f"{path}: byte 0 is not UTF-8 text"
    path.write_text("just words")
    assert message(path).startswith(f"{path}: must hold a lens: ROS camera_info (image_width, camera_matrix, …), or ")
