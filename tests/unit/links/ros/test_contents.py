"""The contents of ROS 2 messages: frames of reference, covariance, what is withheld; and that they are whole."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ledpi.core.records import COEFFICIENTS, CameraInfo, DistortionModel, Intrinsics
from ledpi.links.bags.contents import Info, lens_of_info
from ledpi.links.ros.contents import (
    DETECTIONS,
    DIAGNOSTICS,
    DOCK_POSE,
    ODOMETRY,
    POSE,
    TF,
    UNKNOWN_VARIANCE,
    Message,
    Names,
    camera_info_message,
    frame_messages,
    health_message,
    odometry_messages,
)
from ledpi.links.ros.stream import RosStream
from tests.builders.made_up_daemon import HEALTH, PANEL, decoded

OFFSET_NS = 1_790_000_000_000_000_000
COVARIANCE = list(map(float, range(36)))
PLACE = {"position_m": [1.0, 2.0, 0.5], "quaternion_wxyz": [0.5, 0.5, 0.5, 0.5]}


def frame(**changes: Any) -> dict[str, Any]:
    """Makes one of panel 7, exposed at 5 s, the panel's row 2 ms later."""
    marker = PANEL | {"exposed_ns": 5_002_000_000, "covariance": COVARIANCE} | changes
    return decoded(3) | {"exposed_ns": 5_000_000_000, "markers": [marker]}


def by_topic(line: dict[str, Any], names: Names = Names()) -> dict[str, Message]:  # noqa: B008, it is frozen
    return {message.topic: message for message in frame_messages(line, names, OFFSET_NS)}


def test_a_panel_has_a_pose_with_its_covariance_at_its_own_time() -> None:
    """The quaternion's w is last, the covariance row by row."""
    message = by_topic(frame(quaternion_wxyz=[0.5, 0.1, 0.2, 0.3]))["/ledpi/panel_7"]
    assert message.type == POSE
    assert message.values["header"]["stamp"] == {"sec": 1_790_000_005, "nanosec": 2_000_000}
    assert message.values["header"]["frame_id"] == "camera_optical_frame"
    assert message.values["pose"]["pose"]["orientation"] == {"x": 0.1, "y": 0.2, "z": 0.3, "w": 0.5}
    assert message.values["pose"]["covariance"] == COVARIANCE


def test_a_pose_that_may_be_its_mirror_image_is_in_the_detections_alone() -> None:
    """With both; no listener of TF could tell."""
    messages = by_topic(frame(alternate=PLACE))
    assert messages.keys() == {"/ledpi/detections"}
    (found,) = messages["/ledpi/detections"].values["detections"]
    assert [each["pose"]["pose"]["position"]["x"] for each in found["results"]] == [0.0, 1.0]


def test_nothing_seen_is_news_too() -> None:
    """An empty list of detections."""
    messages = by_topic(decoded(3) | {"markers": []})
    assert messages["/ledpi/detections"].values["detections"] == []


def test_an_id_that_is_read_without_a_lens_is_detected_without_a_pose() -> None:
    """It is not an empty room; NaN is no place that anybody drives to."""
    messages = by_topic(frame(position_m=None, quaternion_wxyz=None, covariance=None))
    assert messages.keys() == {"/ledpi/detections"}
    (found,) = messages["/ledpi/detections"].values["detections"]
    (result,) = found["results"]
    assert (found["id"], result["hypothesis"]["class_id"]) == ("7", "7")
    assert np.isnan(
        [*result["pose"]["pose"]["position"].values(), *found["bbox"]["center"]["orientation"].values()]
    ).all()


def test_two_cameras_that_see_one_panel_give_it_one_parent() -> None:
    """Each has a frame of its own for it, or one is silent."""
    (transform,) = by_topic(frame(), Names(frame_prefix="front/"))["/tf"].values["transforms"]
    assert transform["child_frame_id"] == "front/panel_7"
    assert "/tf" not in by_topic(frame(), Names(publish_tf=False))


def test_a_detections_box_is_as_large_as_the_panel() -> None:
    """The map's side, else the panel's own, else that of all."""
    panels = {"side_m": 0.16, "overrides": {"7": {"side_m": 0.3}}}
    for told, side_m in [({}, 0.3), ({"map": {"7": {"side_m": 0.5}}}, 0.5), ({"panels": {"side_m": 0.16}}, 0.16)]:
        stream = RosStream(Names())
        stream.begin({"panels": panels, "map": None} | told)
        (found,) = stream.frame(frame(), OFFSET_NS)[0].values["detections"]
        assert found["bbox"]["size"] == {"x": side_m, "y": side_m, "z": 0.0}


def test_an_unknown_covariance_gives_a_filter_no_weight() -> None:
    """Zeros would be taken for certainty."""
    message = by_topic(frame(covariance=None))["/ledpi/panel_7"]
    np.testing.assert_array_equal(np.diag(np.reshape(message.values["pose"]["covariance"], (6, 6))), UNKNOWN_VARIANCE)


def test_the_robot_is_in_the_map() -> None:
    """By REP-105 the map's frame; whoever localises publishes TF from it."""
    robot = PLACE | {"covariance": COVARIANCE, "exposed_ns": 5_001_000_000, "panels_used": [7]}
    messages = by_topic(frame() | {"robot": robot})
    assert messages["/ledpi/pose"].values["header"]["frame_id"] == "map"
    assert messages["/ledpi/pose"].stamp_ns == OFFSET_NS + 5_001_000_000
    (transform,) = messages["/tf"].values["transforms"]
    assert transform["child_frame_id"] == "panel_7"


STATE: dict[str, Any] = {"t_ns": 5_000_000_000, "position_m": [1.0, 2.0], "yaw_rad": np.pi / 2, "velocity": [0.5, 0.1]}
STATE |= {"covariance": list(map(float, range(1, 10)))}


def test_the_state_is_odometry_in_the_map() -> None:
    """In the plane: what is not known of height, roll and pitch has no weight. Without a state there is none."""
    (message,) = odometry_messages(STATE, Names(), OFFSET_NS)
    assert (message.topic, message.stamp_ns) == ("/ledpi/odometry", 5_000_000_000 + OFFSET_NS)
    values, pose = message.values, message.values["pose"]["pose"]
    assert (values["header"]["frame_id"], values["child_frame_id"]) == ("map", "base_link")
    assert (pose["position"]["x"], pose["position"]["y"]) == (1.0, 2.0)
    assert (pose["orientation"]["z"], pose["orientation"]["w"]) == pytest.approx((0.5**0.5, 0.5**0.5))
    covariance = np.reshape(values["pose"]["covariance"], (6, 6))
    assert covariance[np.ix_([0, 1, 5], [0, 1, 5])].ravel().tolist() == STATE["covariance"]
    assert covariance[2, 2] == covariance[3, 3] == covariance[4, 4] == UNKNOWN_VARIANCE
    assert (values["twist"]["twist"]["linear"]["x"], values["twist"]["twist"]["angular"]["z"]) == (0.5, 0.1)
    assert odometry_messages(STATE | {"position_m": None}, Names(), OFFSET_NS) == []


def test_a_docks_x_points_into_it() -> None:
    """Panel 7 hangs upright and faces the camera, 2 m ahead: a robot that docks looks as the camera does."""
    facing = frame(quaternion_wxyz=[0.0, 1.0, 0.0, 0.0])  # x right, y up, z back to the camera
    message = by_topic(facing, Names(dock_id=7))["/detected_dock_pose"]
    turned = message.values["pose"]["orientation"]
    x, y, z, w = (turned[key] for key in "xyzw")
    ahead = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]  # its z, in the camera's frame
    into = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)]  # its x
    np.testing.assert_allclose(into, [0, 0, 1], atol=1e-12)  # where the camera looks
    np.testing.assert_allclose(ahead, [0, -1, 0], atol=1e-12)  # up


@pytest.mark.parametrize(("state", "level"), [("running", 0), ("camera_lost", 2), ("no_daemon", 3)])
def test_diagnostics_say_how_the_daemon_is(state: str, level: int) -> None:
    """OK, ERROR, and STALE where nobody tells."""
    message = health_message(state, HEALTH if state == "running" else None, Names(), OFFSET_NS)
    (status,) = message.values["status"]
    assert (status["level"], status["message"]) == (level, state.replace("_", " "))


@pytest.mark.parametrize(
    ("health", "line", "message"),
    [
        ({"decoded_per_s": 0.0}, {}, "nothing is decoded"),
        ({"no_fix": "behind"}, {}, "frames are decoded too late: this computer is too slow"),
        ({"no_fix": "uncalibrated"}, {}, "no lens is known: calibrate it (camera.intrinsics)"),
        ({}, {"rejected": {"fix.panels_contradict": 1}}, "panels contradict the map"),
        ({}, {"robot": PLACE | {"exposed_ns": 5, "panels_rejected": [7]}}, "panels contradict the map"),
    ],
)
def test_diagnostics_warn_of_what_a_person_must_put_right(health: Any, line: Any, message: str) -> None:
    """Though frames come; and no longer than it lasts."""
    stream = RosStream(Names())
    stream.frame(frame() | line, OFFSET_NS)
    (status,) = stream.health("running", HEALTH | health, OFFSET_NS).values["status"]
    assert (status["level"], status["message"]) == (1, message)
    (status,) = stream.health("running", HEALTH, OFFSET_NS).values["status"]
    assert (status["level"], status["message"]) == (0, "running")


@pytest.mark.parametrize("model", COEFFICIENTS)
def test_the_lens_has_its_own_model(model: DistortionModel) -> None:
    """By a name of ROS's three, with all its numbers; a bag's reader makes the same lens of it."""
    bent = tuple(0.01 * place for place in range(1, 1 + len(COEFFICIENTS[model])))
    lens = Intrinsics(width=640, height=480, fx=600, fy=600, cx=320, cy=240, distortion=bent, distortion_model=model)
    camera = CameraInfo(
        width=640,
        height=480,
        exposure_us=10.0,
        row_time_us=33.0,
        transfer="srgb",
        frame_length_rows=500,
        intrinsics=lens,
    )
    values = camera_info_message(camera, "/camera_info", 0, "camera").values
    assert values["distortion_model"] in {"plumb_bob", "rational_polynomial", "equidistant"}
    assert lens_of_info(Info.model_validate(values), 640, 480, "bag") == lens


def test_every_message_is_whole() -> None:
    """rosbags, which knows ROS 2's types, writes and reads each again."""
    types = pytest.importorskip("ledpi.links.ros.types")
    robot = PLACE | {"covariance": COVARIANCE, "exposed_ns": 5_001_000_000, "panels_used": [7]}
    messages = frame_messages(frame() | {"robot": robot}, Names(dock_id=7), OFFSET_NS)
    messages.append(health_message("running", HEALTH, Names(), OFFSET_NS))
    messages += odometry_messages(STATE, Names(), OFFSET_NS)
    assert {message.type for message in messages} == {DETECTIONS, TF, POSE, DOCK_POSE, DIAGNOSTICS, ODOMETRY}
    for message in messages:
        data = types.to_cdr(message.type, message.values)
        again = types.types().deserialize_cdr(data, message.type)
        assert bytes(types.types().serialize_cdr(again, message.type)) == data


def test_the_hashes_of_types_are_those_that_ros_2_publishes() -> None:
    """REP-2016's own numbers, as rmw_zenoh's names hold them."""
    types = pytest.importorskip("ledpi.links.ros.types")
    wanted = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    assert types.type_hash("std_msgs/msg/String") == wanted
