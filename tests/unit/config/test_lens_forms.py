"""The lens's file of each calibration tool is read as ROS's is, and what cannot be read is told by its own key."""

from __future__ import annotations

import json
import logging
from dataclasses import replace
from pathlib import Path

import pytest

from ledpi.config.camera_yaml import load_intrinsics
from ledpi.core.errors import CalibrationError
from ledpi.core.records import Intrinsics

BENT = (0.1, -0.2, 0.0005, -0.0005, 0.06)
LENS = Intrinsics(width=640, height=480, fx=642.5, fy=643.5, cx=322.25, cy=237.5, distortion=BENT)
FISHEYE_BENT, RATIONAL_BENT = (
    (0.175653, -0.031772, 0.000362, -0.000719),
    (0.26, 0.11, -0.001, 0, 0.28, 0.25, 0.19, 0.11),
)
FISHEYE = replace(LENS, fx=300.5, fy=301.5, distortion=FISHEYE_BENT, distortion_model="equidistant")
RATIONAL = replace(LENS, distortion=RATIONAL_BENT, distortion_model="rational_polynomial")

K = "642.5, 0, 322.25, 0, 643.5, 237.5, 0, 0, 1"
D = "0.1, -0.2, 0.0005, -0.0005, 0.06"
FISHEYE_K = "300.5, 0., 322.25, 0., 301.5, 237.5, 0., 0., 1."
FISHEYE_D = "0.175653, -0.031772, 0.000362, -0.000719"
RATIONAL_D = "0.26, 0.11, -0.001, 0, 0.28, 0.25, 0.19, 0.11"
ROS = "image_width: 640\nimage_height: 480\ncamera_matrix: {{rows: 3, cols: 3, data: [{}]}}\n"
COEFFICIENTS = "distortion_coefficients: {{rows: 1, cols: {}, data: [{}]}}\n"


def opencv(matrix: str, coefficients: str, more: str = "") -> str:
    return (
        '%YAML:1.0\n---\ncalibration_time: "Tue Nov 25 2025"\nimage_width: 640\nimage_height: 480\n'
        f"{more}camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ {matrix} ]\n"
        f"distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   data: [ {coefficients} ]\n"
    )


XML = """<?xml version="1.0"?>
<opencv_storage>
<calibration_Time>"Mon Apr 17 14:24:32 2023"</calibration_Time>
<image_Width>640</image_Width>
<image_Height>480</image_Height>
<Camera_Matrix type_id="opencv-matrix">
  <rows>3</rows><cols>3</cols><dt>d</dt>
  <data>
    6.425e+02 0. 3.2225e+02 0. 6.435e+02 2.375e+02 0. 0. 1.</data></Camera_Matrix>
<Distortion_Coefficients type_id="opencv-matrix">
  <rows>5</rows><cols>1</cols><dt>d</dt>
  <data>
    1e-1 -2e-1 5e-4 -5e-4 6e-2</data></Distortion_Coefficients>
</opencv_storage>
"""
INI = """# Camera intrinsics

[image]

width
640

height
480

[cam]

camera matrix
642.5 0.000000 322.25
0.000000 643.5 237.5
0.000000 0.000000 1.000000

distortion
0.1 -0.2 0.0005 -0.0005 0.06

rectification
1 0 0
0 1 0
0 0 1
"""
ECHO = f"""header:
  stamp:
    sec: 1
  frame_id: camera
height: 480
width: 640
distortion_model: plumb_bob
d:
- {D.replace(", ", chr(10) + "- ")}
k:
- {K.replace(", ", chr(10) + "- ")}
---
"""
KALIBR = """cam0:
  cam_overlaps: []
  camera_model: {model}
  distortion_coeffs: [{coefficients}]
  distortion_model: {distortion}
  intrinsics: [{intrinsics}]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
"""


def photonvision(coefficients: str, model: str = "LENSMODEL_OPENCV") -> str:
    matrix = {"rows": 3, "cols": 3, "type": 6, "data": json.loads(f"[{K}]")}
    bent = {"rows": 1, "cols": 8, "type": 6, "data": json.loads(f"[{coefficients}]")}
    camera = {"resolution": {"width": 640.0, "height": 480.0}, "cameraIntrinsics": matrix, "distCoeffs": bent}
    return json.dumps({**camera, "calobjectWarp": [0.1, 0.2], "observations": [], "lensmodel": model})


OMNI = KALIBR.format(model="omni", distortion="radtan", coefficients="0, 0, 0, 0", intrinsics="0.7, 770, 770, 362, 247")
FOV = KALIBR.format(model="pinhole", distortion="fov", coefficients="0.9", intrinsics="300, 300, 320, 240")

FORMS = {
    "ROS": (ROS.format(K) + "distortion_model: plumb_bob\n" + COEFFICIENTS.format(5, D), LENS),
    "ROS, 8 of which 3 are 0": (ROS.format(K) + COEFFICIENTS.format(8, D + ", 0, 0, 0"), LENS),
    "ROS, rational of 5": (ROS.format(K) + "distortion_model: rational_polynomial\n" + COEFFICIENTS.format(5, D), LENS),
    "ROS, rational": (
        ROS.format(K) + "distortion_model: rational_polynomial\n" + COEFFICIENTS.format(8, RATIONAL_D),
        RATIONAL,
    ),
    "ROS 1, camera_model": (ROS.format(K) + "camera_model: plumb_bob\n" + COEFFICIENTS.format(5, D), LENS),
    "ROS, fisheye": (ROS.format(FISHEYE_K) + "camera_model: fisheye\n" + COEFFICIENTS.format(4, FISHEYE_D), FISHEYE),
    "ROS 2, equidistant": (
        ROS.format(FISHEYE_K) + "distortion_model: equidistant\n" + COEFFICIENTS.format(4, FISHEYE_D),
        FISHEYE,
    ),
    "ROS, .ini": (INI, LENS),
    "ROS 2, echo": (ECHO, LENS),
    "ROS 2, two echoes": (ECHO + ECHO, LENS),
    "ROS 1, echo": (
        f'height: 480\nwidth: 640\ndistortion_model: "plumb_bob"\nD: [{D}]\nK: [{K}]\nR: [1.0]\n---\n',
        LENS,
    ),
    "OpenCV, YAML": (opencv(K.replace(", 0,", ", 0.,"), D), LENS),
    "OpenCV 5, arrays of one dimension": (
        "%YAML 1.2\n---\nimageSize: !!opencv-nd-matrix\n   sizes: [ 2 ]\n   dt: i\n   data: [ 640, 480 ]\n"
        f"K: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ {K} ]\n"
        f"D: !!opencv-nd-matrix\n   sizes: [ 5 ]\n   dt: d\n   data: [ {D} ]\n",
        LENS,
    ),
    "OpenCV, YAML without commas": (opencv(K.replace(", 0,", ", 0.,"), D.replace(",", " ")), LENS),
    "OpenCV, XML": (XML, LENS),
    "OpenCV, fisheye": (opencv(FISHEYE_K, FISHEYE_D, "fisheye_model: 1\n"), FISHEYE),
    "OpenCV, no fisheye": (opencv(K, D.rpartition(",")[0], "fisheye_model: 0\n"), None),
    "OpenCV, Python": (
        f"width: 640\nheight: 480\nmtx: [[642.5, 0, 322.25], [0, 643.5, 237.5], [0, 0, 1]]\ndist: [[{D}]]\n",
        LENS,
    ),
    "Kalibr": (
        KALIBR.format(model="pinhole", distortion="radtan", coefficients=D, intrinsics="642.5, 643.5, 322.25, 237.5"),
        LENS,
    ),
    "Kalibr, equidistant": (
        KALIBR.format(
            model="pinhole", distortion="equidistant", coefficients=FISHEYE_D, intrinsics="300.5, 301.5, 322.25, 237.5"
        ),
        FISHEYE,
    ),
    "PhotonVision": (photonvision(D + ",0.0,0.0,0.0"), LENS),
    "PhotonVision, the height first": (
        photonvision(D + ",0,0,0").replace('"width": 640.0, "height": 480.0', '"height": 480.0, "width": 640.0'),
        LENS,
    ),
    "PhotonVision, rational": (photonvision(RATIONAL_D), RATIONAL),
}


TWO = FORMS["Kalibr"][0] + FORMS["Kalibr"][0].replace("cam0", "cam1")


def written(folder: Path, text: str) -> Path:
    path = folder / "lens.file"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("form", FORMS)
def test_each_tools_file_is_read(tmp_path: Path, form: str) -> None:
    """Whatever the form, the numbers are the lens's."""
    text, lens = FORMS[form]
    found = load_intrinsics(written(tmp_path, text))
    assert found == (lens or replace(LENS, distortion=(*BENT[:4], 0.0)))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (OMNI, "camera_model: 'omni' is not known; must be plumb_bob (radtan), rational_polynomial, thin_prism or "),
        (FOV, "distortion_model: 'fov' is not known"),
        (TWO, "holds several cameras (cam0, cam1); must hold one"),
        (photonvision("0,0,0,0", "LENSMODEL_STEREOGRAPHIC"), "lensmodel: 'LENSMODEL_STEREOGRAPHIC' is not known"),
        (photonvision("0,0"), "distCoeffs: must be 4, 5, 8 or 12 numbers"),
        (ROS.format(FISHEYE_K) + COEFFICIENTS.format(4, FISHEYE_D), "are 4 numbers without the model's name"),
        (ROS.format(FISHEYE_K) + "distortion_model: equidistant\n" + COEFFICIENTS.format(5, D),
         "distortion_coefficients: must be 4 numbers, k1 k2 k3 k4, for an equidistant lens, not 5"),
        (ROS.format(K) + COEFFICIENTS.format(14, D + ", 0, 0, 0, 0, 0, 0, 0, 0.1, 0.1"), "a tilted sensor"),
        (ROS.format(K) + "distortion_model: scaramuzza\n" + COEFFICIENTS.format(5, D), "'scaramuzza' is not known"),
        (XML.replace("<image_Width>640</image_Width>\n", ""), "image_width: must be given"),
        (XML.replace("<?xml version=\"1.0\"?>", "<!DOCTYPE x [<!ENTITY a 'b'>]>"), "its XML declares something"),
        (XML[:300], "not valid XML"),
        (photonvision(D)[:100], "not valid JSON"),
        ("{\"tags\": []}", "must hold a lens: "),
        (ROS.format(K) + "distortion_model: plumb_bob\ndistortion_parameters: [0.1, -0.2, 0, 0, 0.06]\n",
         "distortion_coefficients: must be given"),
        (photonvision(D).replace("distCoeffs", "cameraExtrinsics"), "distortion_coefficients: must be given"),
    ],
)  # fmt: skip
def test_what_is_no_known_lens_is_refused(tmp_path: Path, text: str, expected: str) -> None:
    """A model or a form that is not known is named, never taken for another."""
    path = written(tmp_path, text)
    with pytest.raises(CalibrationError) as caught:
        load_intrinsics(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_lens_that_folds_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The directions of its outer pixels are not one: where that begins is said; nothing of a lens without a fold."""
    folding = ROS.format("500, 0, 320, 0, 500, 240, 0, 0, 1") + COEFFICIENTS.format(5, "-0.4, 0, 0, 0, 0")
    with caplog.at_level(logging.WARNING):
        load_intrinsics(written(tmp_path, FORMS["ROS"][0]))
        load_intrinsics(written(tmp_path, FORMS["ROS, fisheye"][0]))
        assert not caplog.messages
        load_intrinsics(written(tmp_path, folding))
    assert "its distortion folds within the picture: from 30" in caplog.text  # 304 px, on a grid
    wide = ROS.format("150, 0, 320, 0, 150, 240, 0, 0, 1") + "camera_model: fisheye\n"
    wide += COEFFICIENTS.format(4, "0, 0, 0, 0")
    with caplog.at_level(logging.WARNING):
        load_intrinsics(written(tmp_path, wide))
    assert "it sees further than 89° aside: from 23" in caplog.text
