"""`import ledpi`: markers with their poses from pictures that a program has, and a clear error for what is none."""

from __future__ import annotations

import dataclasses
import doctest
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ledpi
import ledpi.pipeline.api.lens
import ledpi.pipeline.api.reader
from ledpi.config.camera_yaml import camera_yaml_text
from ledpi.core.geometry import quaternion_from_matrix
from ledpi.core.records import Detection, Floats, MarkerPose, Pixels, PlanarSolution, Pose
from ledpi.pipeline.api.exposed import checked_picture
from ledpi.pipeline.api.lens import Marker, marker_of
from tests.builders.api import INTRINSICS, LENS, ROW_TIME_US, pictures

NEAR_M, FAR_M = 1.0, 3.0  # FAR_M takes more than one picture


@pytest.fixture(scope="module")
def near() -> Pixels:
    return pictures(1, distance_m=NEAR_M)[0][0]


def reader(**values: Any) -> ledpi.Reader:
    return ledpi.Reader(**{"side_m": 0.16, "lens": LENS} | values)


# ---- What is drawn


def test_a_picture_is_drawn_with_its_markers(near: Pixels) -> None:
    """In colour: each cell has its class's, blue or orange; beside the panel the picture is only dimmer."""
    asked = reader()
    (marker,) = asked.read(near, row_time_us=ROW_TIME_US)
    picture = asked.draw(near, [marker])
    assert (picture.shape, picture.dtype) == ((480, 640, 3), np.uint8)
    assert np.abs(picture[:100].astype(float) - 0.7 * near[:100, :, None]).max() <= 1.0
    top_left, top_right, bottom_right, bottom_left = marker.corners_px
    for row, classes in enumerate(["WWBB", "BWBB", "WWWW", "BBWB"]):  # ID 7 of DICT_4X4_50
        for column, of in enumerate(classes):
            u, v = (column + 0.2) / 4, (row + 0.2) / 4  # of the cell's corner: axes and words lie elsewhere
            at = (1 - v) * ((1 - u) * top_left + u * top_right) + v * ((1 - u) * bottom_left + u * bottom_right)
            blue, _, red = picture[round(at[1]), round(at[0])].astype(int)
            assert (red > blue + 40) == (of == "W"), (row, column)
            assert (blue > red + 40) == (of == "B"), (row, column)


def test_what_is_drawn_needs_a_picture_of_the_lens(near: Pixels) -> None:
    """And no marker need be there; without a lens no axes are."""
    assert np.array_equal(reader().draw(near, []), np.repeat((near * 0.7).astype(np.uint8)[..., None], 3, axis=2))
    with pytest.raises(ledpi.PictureError, match=r"^image: must be 640 × 480"):
        reader().draw(near[:100], [])
    without = reader(lens=None)
    markers = without.read(near, row_time_us=ROW_TIME_US)
    stream = reader(lens=None).stream(row_time_us=ROW_TIME_US)
    assert np.array_equal(without.draw(near, markers), stream.draw(near, markers))
    assert not np.array_equal(without.draw(near, markers), reader().draw(near, reader().read(near, row_time_us=33.67)))


# ---- What is read


def test_a_picture_gives_the_marker_and_its_pose(near: Pixels) -> None:
    """The simulated panel's ID, place and yaw, with a covariance."""
    (marker,) = reader().read(near, row_time_us=ROW_TIME_US)
    assert marker.id == 7
    assert marker.position_m == pytest.approx([0.0, 0.0, NEAR_M], abs=0.005)
    assert marker.distance_m == pytest.approx(NEAR_M, abs=0.005)
    assert (marker.yaw, marker.pitch, marker.roll) == pytest.approx((math.radians(20), 0.0, 0.0), abs=0.02)
    assert marker.covariance is not None
    assert marker.covariance.shape == (6, 6)
    assert marker.corners_px.shape == (4, 2)
    assert marker.frames_used == 1


def test_the_lens_may_be_a_file(near: Pixels, tmp_path: Path) -> None:
    """camera.yaml gives the same pose as the numbers in it."""
    path = tmp_path / "camera.yaml"
    path.write_text(camera_yaml_text(INTRINSICS, {}), encoding="utf-8")
    (by_file,) = reader(lens=path).read(near, row_time_us=ROW_TIME_US)
    (by_numbers,) = reader().read(near, row_time_us=ROW_TIME_US)
    assert by_file.position_m == pytest.approx(by_numbers.position_m, abs=1e-9)


def test_without_a_lens_there_are_no_poses(near: Pixels) -> None:
    """The ID and the corners are there, and nothing is made up."""
    (marker,) = reader(lens=None).read(near, row_time_us=ROW_TIME_US)
    assert marker.id == 7
    poses = (marker.position_m, marker.quaternion_wxyz, marker.covariance, marker.mirrored)
    assert (*poses, marker.distance_m, marker.yaw, marker.pitch, marker.roll) == (None,) * 8


def test_ids_that_do_not_exist_are_not_read(near: Pixels) -> None:
    """And the reason is said."""
    other = reader(ids=np.array([23]))
    assert other.read(near, row_time_us=ROW_TIME_US) == []
    assert other.rejected["identify.id_not_in_panels_ids"] == 1


def test_a_stream_reads_what_one_picture_does_not_show() -> None:
    """Pictures of a far panel add up; each by itself gives nothing."""
    taken = pictures(6, distance_m=FAR_M)
    single, stream = reader(), reader().stream(row_time_us=ROW_TIME_US)
    assert [single.read(image, row_time_us=ROW_TIME_US) for image, _ in taken] == [[]] * 6
    (marker,) = [stream.read(image, time_ns=time_ns) for image, time_ns in taken][-1]
    assert marker.id == 7
    assert marker.frames_used > 1
    assert taken[-1][1] - 10_000_000 < marker.time_ns < taken[-1][1] + 20_000_000


@pytest.mark.parametrize(
    ("axis", "name"), [(1, "yaw"), (0, "pitch"), (2, "roll")], ids=["about y", "about x", "about z"]
)
@pytest.mark.parametrize("angle", [-1.2, 0.3])
def test_angles_are_those_of_the_camera_s_axes(axis: int, name: str, angle: float) -> None:
    """A panel that faced the camera, turned about one of them by the right-hand rule."""
    a, b = ((1, 2), (2, 0), (0, 1))[axis]
    turn = np.eye(3)
    turn[a, a] = turn[b, b] = math.cos(angle)
    turn[b, a], turn[a, b] = math.sin(angle), -math.sin(angle)
    marker = turned(turn @ np.diag([1.0, -1.0, -1.0]))
    found = {"yaw": marker.yaw, "pitch": marker.pitch, "roll": marker.roll}
    assert found == pytest.approx({"yaw": 0.0, "pitch": 0.0, "roll": 0.0} | {name: angle}, abs=1e-12)


def turned(rotation: Floats) -> Marker:
    """One with this rotation, whose mirrored pose has the same."""
    pose = Pose(position_m=np.array([0.0, 0.0, 1.0]), quaternion_wxyz=quaternion_from_matrix(rotation))
    solution = PlanarSolution(camera_from_marker=pose, reprojection_px=0.0, chi2=0.0)
    detection = Detection(
        id=7, corners_px=np.zeros((4, 2)), covariance_px2=0.01 * np.eye(8), margin=20.0, frames_used=1
    )
    return marker_of(MarkerPose(detection=detection, mid_exposure_ns=0, solution=solution, alternate=solution))


def test_a_pose_that_is_not_sure_comes_with_the_other() -> None:
    """Comes of the same detection; that has no third."""
    marker = turned(np.diag([1.0, -1.0, -1.0]))
    assert marker.mirrored is not None
    assert (marker.mirrored.id, marker.mirrored.mirrored) == (7, None)


# ---- Pictures that do not fit


@pytest.mark.parametrize(
    ("image", "said"),
    [
        (None, "image: must be grey, (height, width) uint8, as a numpy array, not NoneType; cv2.imread and others "),
        ([[0]], "image: must be grey, (height, width) uint8, as a numpy array, not list"),
        (np.zeros((480, 640, 3), np.uint8), "image: must be grey, (height, width) uint8, not (480, 640, 3) uint8: of "),
        (np.zeros((480, 640)), "image: must be grey, (height, width) uint8, not (480, 640) float64"),
        (np.zeros((480, 640), np.uint16), "image: must be grey, (height, width) uint8, not (480, 640) uint16"),
        (np.zeros(480, np.uint8), "image: must be grey, (height, width) uint8, not (480) uint8"),
        (np.zeros((720, 640), np.uint8), "image: must be 640 × 480 pixels, as the lens says, not 640 × 720: below its"),
        (np.zeros((240, 320), np.uint8), "image: must be 640 × 480 pixels, as the lens says, not 320 × 240"),
    ],
)
def test_a_picture_that_does_not_fit_is_refused(image: Any, said: str, tmp_path: Path) -> None:
    """In one line; and programs may catch it as a ValueError."""
    path = tmp_path / "camera.yaml"
    path.write_text(camera_yaml_text(INTRINSICS, {}), encoding="utf-8")
    with pytest.raises(ledpi.PictureError) as caught:
        reader(lens=path).read(image, row_time_us=ROW_TIME_US)
    assert str(caught.value).startswith(said)
    assert isinstance(caught.value, ValueError)
    assert isinstance(caught.value, ledpi.LedpiError)


def test_a_stream_keeps_its_size() -> None:
    """A smaller picture in between is refused, and the stream goes on."""
    stream = reader(lens=None).stream(row_time_us=ROW_TIME_US)
    (first, first_ns), (second, second_ns) = pictures(2, distance_m=NEAR_M)
    stream.read(first, time_ns=first_ns)
    with pytest.raises(ledpi.PictureError, match=r"must be 640 × 480 pixels, as the stream began, not 320 × 240"):
        stream.read(first[:240, :320], time_ns=first_ns + 1)
    assert [marker.id for marker in stream.read(second, time_ns=second_ns)] == [7]


@pytest.mark.parametrize(
    ("time_ns", "said"),
    [
        (1_000, "time_ns: must be after the picture's before, 1000, not 1000"),
        (0.5, "time_ns: must be whole nanoseconds, not 0.5"),
    ],
)
def test_a_time_that_cannot_be_is_refused(time_ns: Any, said: str, near: Pixels) -> None:
    """Seconds in place of nanoseconds, and pictures out of their order."""
    stream = reader().stream(row_time_us=ROW_TIME_US)
    stream.read(near, time_ns=1_000)
    with pytest.raises(ledpi.PictureError) as caught:
        stream.read(near, time_ns=time_ns)
    assert str(caught.value) == said


def test_a_picture_is_neither_changed_nor_locked(near: Pixels) -> None:
    """The camera's next frame may be written into it."""
    own = near.copy()
    reader().read(own, row_time_us=ROW_TIME_US)
    assert own.flags.writeable
    assert (own == near).all()


def test_a_part_of_a_wider_array_is_a_picture(near: Pixels) -> None:
    """As picamera2's rows with their padding, and ROS's with their step."""
    padded = np.zeros((720, 704), np.uint8)
    padded[:480, :640] = near
    (marker,) = reader().read(padded[:480, :640], row_time_us=ROW_TIME_US)
    assert marker.id == 7


@pytest.mark.slow
def test_pictures_turned_by_180_degrees_are_read_from_below() -> None:
    """A camera that is mounted upside down: a far panel is read as in the pictures that were not turned."""
    taken = pictures(12, distance_m=3.5)
    read = {}
    for turned, rows_from in ((False, "above"), (True, "below"), (True, "above")):
        stream = reader(lens=None, rows_from=rows_from).stream(row_time_us=ROW_TIME_US)
        seen = [image[::-1, ::-1].copy() if turned else image for image, _ in taken]
        found = [stream.read(image, time_ns=time_ns) for image, (_, time_ns) in zip(seen, taken, strict=True)]
        read[turned, rows_from] = sum(markers[0].id == 7 for markers in found if markers)
    assert read[False, "above"] >= 6
    assert read[True, "below"] >= read[False, "above"] - 1
    assert read[True, "above"] < read[True, "below"]


# ---- Values that cannot be


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"side_m": 160}, "side_m: must be in metres, 10 at most (160 mm are 0.16), not 160"),
        ({"side_m": float("nan")}, "side_m: must be "),
        ({"dictionary": "DICT_9X9"}, "dictionary: must be one of "),
        ({"ids": [700]}, "ids: DICT_4X4_50 has only the IDs 0 to 49, not 700"),
        ({"white_hz": 2.45}, "white_hz: must be "),
        ({"transfer": "gamma"}, "transfer: must be "),
        ({"lens": "nowhere.yaml"}, "nowhere.yaml: "),
        ({"lens": 5}, "lens: must be a path, not 5"),
        ({"ids": "23"}, "ids: must be whole numbers, as [7, 23], not '23'"),
        ({"ids": 7}, "ids: must be whole numbers, as [7, 23], not 7"),
        ({"ids": range(10**9)}, "ids: no dictionary has more than 65536 IDs"),
        ({"ids": [7.5]}, "ids: must be whole numbers, as [7, 23], not [7.5]"),
        ({"overrides": {7: {"side": 0.3}}}, "overrides.7.side: unknown key; did you mean side_m?"),
        ({"overrides": [7]}, 'overrides: must be as {7: {"side_m": 0.3}}, not [7]'),
        ({"camera_mount": {"rpy": [0, 0, 0]}}, "camera_mount.rpy: unknown key"),
        ({"map": 3}, "map: must be a path, not 3"),
        ({"odometry": {"base_m": 0}}, "odometry.base_m: must be greater than or equal to 0.01"),
        ({"upright": "yes, all"}, "upright: must be true or false"),
    ],
)
def test_a_value_that_cannot_be_is_refused_at_once(values: dict[str, Any], said: str) -> None:
    """As the reader is made, in one line that names it."""
    with pytest.raises(ledpi.LedpiError) as caught:
        reader(**values)
    assert str(caught.value).startswith(said)


@pytest.mark.parametrize(
    ("exposed", "said"),
    [
        ({"row_time_us": 33.67, "exposure_us": 10}, "exposure_us: must be at least row_time_us, 33.67 "),
        ({"row_time_us": "auto"}, "row_time_us: must be a number of microseconds, not 'auto'"),
        ({"row_time_us": None}, "row_time_us: must be "),
        ({"row_time_us": 33.67, "exposure_us": [10000]}, "exposure_us: must be "),
    ],
)
def test_times_that_cannot_be_are_named(exposed: dict[str, Any], said: str, near: Pixels) -> None:
    """10 µs were meant as 10 ms; what is no number is no time."""
    with pytest.raises(ledpi.LedpiError) as caught:
        reader().read(near, **exposed)
    assert str(caught.value).startswith(said)


@pytest.mark.parametrize("of", ["reader", "stream"])
def test_two_threads_at_once_are_refused(near: Pixels, of: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rather than mixed up; afterwards it goes on. (Here the other one comes while a picture is looked at.)"""
    shared = reader()
    stream = shared.stream(row_time_us=ROW_TIME_US)
    read = {
        "reader": lambda: shared.read(near, row_time_us=ROW_TIME_US),
        "stream": lambda: stream.read(near, time_ns=1),
    }
    refused = []

    def meanwhile(image: Pixels) -> Pixels:
        with pytest.raises(ledpi.PictureError, match=f"this {of} is in use by another thread"):
            read[of]()
        refused.append(of)
        return checked_picture(image)

    monkeypatch.setattr("ledpi.pipeline.api.reader.checked_picture", meanwhile)
    assert [marker.id for marker in read[of]()] == [7]
    assert refused == [of]


# ---- More than markers


def test_a_body_is_where_its_panel_is(near: Pixels) -> None:
    """Its origin at the panel's centre: as the marker. Without bodies there are none."""
    placed, plain = reader(bodies={"dock": {7: {"position_m": [0, 0, 0], "yaw_deg": 0}}}), reader()
    (marker,) = placed.read(near, row_time_us=33.67)
    dock = placed.bodies["dock"]
    assert marker.position_m is not None
    np.testing.assert_allclose(dock.position_m, marker.position_m, atol=2e-3)
    assert dock.to_dict()["panels_used"] == [7]
    assert plain.read(near, row_time_us=33.67)
    assert plain.bodies == {}
    with pytest.raises(ledpi.LedpiError, match=r"^bodies\.dock\.7\.side_m: unknown key"):
        reader(bodies={"dock": {7: {"position_m": [0, 0, 0], "yaw_deg": 0, "side_m": 0.2}}})


def test_a_map_tells_where_the_robot_is(near: Pixels, tmp_path: Path) -> None:
    """Before the panel, at its distance, the camera's mount counted in; without a map there is no fix."""
    (tmp_path / "markers.yaml").write_text("panels: {7: {position_m: [0, 0, 1], yaw_deg: 180}}\n")
    placed = reader(map=tmp_path / "markers.yaml", upright=True, camera_mount={"position_m": [0.1, 0, 0]})
    (marker,) = placed.read(near, row_time_us=33.67)
    assert placed.fix is not None
    assert marker.distance_m is not None
    assert np.hypot(*placed.fix.position_m[:2]) == pytest.approx(marker.distance_m + 0.1, abs=0.02)
    assert placed.fix.panels_used == (7,)
    assert json.loads(json.dumps(placed.fix.to_dict()))["panels_used"] == [7]
    plain = reader()
    plain.read(near, row_time_us=33.67)
    assert plain.fix is None


def test_a_stream_knows_where_the_robot_is_between_pictures(near: Pixels, tmp_path: Path) -> None:
    """Drives 20 cm ahead, and turns by 0.1 rad, after the only picture; what odometry cannot be is told."""
    (tmp_path / "markers.yaml").write_text("panels: {7: {position_m: [0, 0, 0], yaw_deg: 180}}\n")
    stream = reader(map=tmp_path / "markers.yaml", upright=True).stream(row_time_us=33.67)
    second_ns = 1_000_000_000
    assert stream.state(second_ns) is None
    (marker,) = stream.read(near, time_ns=second_ns)
    for n in range(21):
        time_ns, way = second_ns + n * 20_000_000, 0.01 * n
        assert stream.add_odometry(time_ns=time_ns, left_m=way, right_m=way, yaw_rad=0.005 * n) is None
    state, first = stream.state(time_ns), stream.fix
    assert state is not None
    assert first is not None
    assert marker.distance_m is not None
    moved = state.position_m - first.position_m[:2]
    assert (np.hypot(*moved), state.heading - first.heading) == pytest.approx((0.2, 0.1), abs=0.01)
    assert (state.by_odometry, state.way_m) == (True, pytest.approx(0.2, abs=0.02))
    assert json.loads(json.dumps(state.to_dict()))["moved"] == []
    assert stream.add_odometry(time_ns=time_ns + 20_000_000, left_m=9.0, right_m=9.0) == "state.odometry_leap"
    with pytest.raises(ledpi.PictureError, match="left_m, right_m: must be two numbers"):
        stream.add_odometry(time_ns=time_ns, left_m=1.0)


def test_why_a_panel_is_not_read_is_told(near: Pixels) -> None:
    """In words, with its place; of one that is read, nothing."""
    (reason,) = reader(ids=[3]).why_not(near, row_time_us=33.67)
    assert reason.says == "this is ID 7, which panels.ids does not list"
    assert reason.is_panel
    assert reason.helps
    assert reader().why_not(near, row_time_us=33.67) == []


def test_a_marker_is_a_dictionary_for_json(near: Pixels) -> None:
    """With the attributes' names; None where there is no pose."""
    (marker,) = reader().read(near, row_time_us=33.67)
    told = json.loads(json.dumps(marker.to_dict()))
    assert told["id"] == 7
    assert told["position_m"] == pytest.approx(marker.position_m.tolist())  # type: ignore[union-attr]
    assert told["yaw"] == pytest.approx(marker.yaw)
    (bare,) = reader(lens=None).read(near, row_time_us=33.67)
    assert bare.to_dict()["distance_m"] is None


@pytest.mark.parametrize("exposed", [{"row_time_us": 33.67e-6}, {"row_time_us": 33.67, "exposure_us": 0.01}])
def test_times_in_seconds_are_refused(exposed: dict[str, float], near: Pixels) -> None:
    """By both, before a picture is read."""
    with pytest.raises(ledpi.LedpiError, match=r"^(row_time|exposure)_us: must be "):
        reader().read(near, **exposed)
    with pytest.raises(ledpi.LedpiError, match=r"^(row_time|exposure)_us: must be "):
        reader().stream(**exposed)


def test_a_lens_of_other_pictures_is_refused(near: Pixels) -> None:
    """Numbers that no lens of this size has: they were in millimetres."""
    with pytest.raises(ledpi.LedpiError, match=r"^lens: fx: must be 64 to 64000 pixels for pictures of 640 × 480"):
        reader(lens=dataclasses.replace(LENS, fx=3.6)).read(near, row_time_us=ROW_TIME_US)
    with pytest.raises(ledpi.LedpiError, match=r"^lens: cy must be a number, in pixels, not '240'"):
        dataclasses.replace(LENS, cy="240")


@pytest.mark.parametrize("matrix", [np.eye(4), [1, 2, 3], [[500, 3, 320], [0, 500, 240], [0, 0, 1]]])
def test_a_matrix_that_is_no_camera_s_is_refused(matrix: Any) -> None:
    """Refuses one of another size, or with skew."""
    with pytest.raises(ledpi.LedpiError, match=r"^lens: the camera matrix must be "):
        ledpi.Lens.from_matrix(matrix, size=(640, 480))


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (
            {"distortion": (0.1, -0.2, 0.001, 0.002)},
            "distortion are 4 numbers without the model's name: must have the mod",
        ),
        ({"distortion": (0.1, -0.2, 0.001)}, "distortion must be 4, 5, 8 or 12 numbers"),
        (
            {"distortion": (0.1,) * 5, "model": "equidistant"},
            "distortion must be 4 numbers, k1 k2 k3 k4, for an equidist",
        ),
        (
            {"model": "scaramuzza"},
            "model must be one of plumb_bob, rational_polynomial, thin_prism, equidistant, not 'sca",
        ),
        ({"size": 640}, "size must be (width, height) of the pictures, not 640"),
        ({"size": (0, 480)}, "size must be (width, height) of the pictures, not (0, 480)"),
    ],
)
def test_a_lens_that_may_be_another_is_refused(values: dict[str, Any], said: str) -> None:
    """A fisheye's four coefficients are none of plumb_bob's, and a size must be given."""
    with pytest.raises(ledpi.LedpiError) as caught:
        ledpi.Lens.from_matrix([500, 0, 320, 0, 500, 240, 0, 0, 1], **{"size": (640, 480), **values})
    assert str(caught.value).startswith(f"lens: {said}")


def test_a_fisheye_s_coefficients_are_those_of_a_fisheye() -> None:
    """k1 to k4 of cv2.fisheye, named so, are an equidistant lens's."""
    matrix, bent = [300, 0, 320, 0, 300, 240, 0, 0, 1], np.array([[0.1], [0.02], [-0.01], [0.001]])
    lens = ledpi.Lens.from_matrix(matrix, bent, size=(640, 480), model="equidistant").intrinsics()
    assert (lens.distortion, lens.distortion_model) == ((0.1, 0.02, -0.01, 0.001), "equidistant")


# ---- The package


def test_all_that_is_promised_is_there() -> None:
    """Each name of `__all__`, and in `dir()`."""
    assert set(ledpi.__all__) <= set(dir(ledpi))
    assert all(getattr(ledpi, name) is not None for name in ledpi.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        ledpi.nonsense  # noqa: B018


def test_importing_it_loads_nothing() -> None:
    """The command's entry point begins with it, and must be ready for Ctrl-C."""
    script = "import sys, ledpi; print({'numpy', 'cv2', 'pydantic', 'ledpi.pipeline.api'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


@pytest.mark.parametrize("module", [ledpi.pipeline.api.lens, ledpi.pipeline.api.reader])
def test_examples_in_docstrings_hold(module: Any) -> None:
    """As Python's own doctest reads them."""
    results = doctest.testmod(module)
    assert results.attempted > 0
    assert results.failed == 0
