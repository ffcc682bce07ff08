"""The ROS 2 package: its node with stand-ins for rclpy, and its files."""

from __future__ import annotations

import re
import sys
import threading
import time
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
import yaml

pytest.importorskip("rosbags", reason="rosbags is not installed")

from rosbags.interfaces import Nodetype

from ledpi.links.ros.types import types as store
from tests.builders import ROOT
from tests.builders.made_up_daemon import HELLO, MadeUpDaemon
from tests.builders.waiting import wait_until

PACKAGE = ROOT / "ros/ledpi_ros"


def kind_of(description: Any) -> str:
    """As rosidl writes a field's type."""
    kind, what = description
    if kind == Nodetype.BASE:
        return {"byte": "octet", "float64": "double"}.get(what[0], what[0])
    if kind == Nodetype.NAME:
        return str(what).replace("/msg/", "/")
    (inner, size) = what
    return f"sequence<{kind_of(inner)}>" if kind == Nodetype.SEQUENCE else f"{kind_of(inner)}[{size}]"


def get_message(name: str) -> type[Any]:
    """A class with rclpy's ways and ROS 2's fields, as rosbags knows them."""
    fields = store().fielddefs[name][1]

    def __init__(self: Any) -> None:  # noqa: N807
        for field, (kind, what) in fields:
            setattr(self, field, get_message(what)() if kind == Nodetype.NAME else None)

    described = {field: kind_of(description) for field, description in fields}
    members = {"__init__": __init__, "kind": name, "get_fields_and_field_types": staticmethod(lambda: described)}
    return type(name, (), members)


class Clockless:
    """rclpy's Node, as far as ours uses it."""

    made: dict[str, list[Any]]

    def __init__(self, name: str) -> None:
        self.made = {}

    def declare_parameter(self, name: str, default: Any) -> Any:
        return types.SimpleNamespace(value=self.given.get(name, default))

    given: dict[str, Any] = {}  # noqa: RUF012

    watched: set[str] = set()  # noqa: RUF012

    def create_publisher(self, kind: type[Any], topic: str, depth: int) -> Any:
        self.made[topic] = []
        return types.SimpleNamespace(
            publish=self.made[topic].append, get_subscription_count=lambda: int(topic in self.watched)
        )

    def get_fully_qualified_name(self) -> str:
        return "/robot1/ledpi"

    def destroy_node(self) -> None:
        self.made = {}

    def get_logger(self) -> Any:
        return types.SimpleNamespace(warning=lambda *_, **__: None)


class Broadcaster:
    """tf2_ros's, which publishes on /tf."""

    def __init__(self, node: Clockless) -> None:
        self._sent: list[Any] = node.made.setdefault("/tf", [])

    def sendTransform(self, transforms: list[Any]) -> None:  # noqa: N802
        self._sent.append(transforms)


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    alive = threading.Event()
    alive.set()
    errors = {name: type(name, (Exception,), {}) for name in ("NameValidationException", "ParameterException")}
    stand_ins = {
        "rclpy": {"init": lambda: None, "ok": alive.is_set, "try_shutdown": alive.clear},
        "rclpy.node": {"Node": Clockless},
        "rclpy.exceptions": errors,
        "rclpy.executors": {"ExternalShutdownException": type("ExternalShutdownException", (Exception,), {})},
        "rosidl_runtime_py": {},
        "rosidl_runtime_py.utilities": {"get_message": get_message},
        "tf2_ros": {"TransformBroadcaster": Broadcaster},
    }
    for name, members in stand_ins.items():
        stand_in = types.ModuleType(name)
        vars(stand_in).update(members)
        monkeypatch.setitem(sys.modules, name, stand_in)
    monkeypatch.syspath_prepend(str(PACKAGE))
    for name in ("ledpi_ros", "ledpi_ros.node", "ledpi_ros.filling"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    import importlib

    yield importlib.import_module("ledpi_ros.node")
    alive.clear()


def test_the_node_publishes_what_the_tap_tells(module: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pose, TF, detections, dock and diagnostics, with the messages' own fields; then that the daemon is gone.

    All but TF and diagnostics is in the node's own namespace.
    """
    daemon = MadeUpDaemon(tmp_path / "tap.sock", numbered=True)
    given = {"socket": str(tmp_path / "tap.sock"), "dock_id": 7, "frame_prefix": "front/"}
    monkeypatch.setattr(Clockless, "given", given)
    node = module.LedpiNode()
    topics = {"ledpi/detections", "ledpi/panel_7", "/tf", "detected_dock_pose", "/diagnostics"}
    wait_until(lambda: set(node.made) >= topics and len(node.made["/tf"]) > 2)
    pose = node.made["ledpi/panel_7"][0]
    assert pose.kind == "geometry_msgs/msg/PoseWithCovarianceStamped"
    assert pose.header.frame_id == "camera_optical_frame"
    assert (pose.pose.pose.position.z, len(pose.pose.covariance)) == (2.0, 36)
    assert abs(pose.header.stamp.sec - time.time()) < 60
    (transform,) = node.made["/tf"][0]
    assert (transform.kind, transform.child_frame_id) == ("geometry_msgs/msg/TransformStamped", "front/panel_7")
    (status,) = node.made["/diagnostics"][-1].status
    assert (status.name, status.level, status.message) == ("robot1/ledpi: daemon", b"\0", "running")
    (found,) = node.made["ledpi/detections"][0].detections
    assert np.isclose(found.results[0].hypothesis.score, 1.0)
    assert found.bbox.size.x == 0.16
    assert node.made["ledpi/image_raw/compressed"] == []  # nobody has subscribed
    assert daemon.asked("picture") == []
    daemon.close()
    wait_until(lambda: node.made["/diagnostics"][-1].status[0].message == "no daemon")
    node.end()


def test_a_picture_comes_with_its_lens_while_somebody_subscribes(
    module: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both have one stamp; and ROS's end ends the node in order."""
    fisheye = {"distortion": [0.1, 0.02, 0.0, 0.0], "distortion_model": "equidistant"}
    daemon = MadeUpDaemon(tmp_path / "tap.sock", hello={"camera": HELLO["camera"] | fisheye})
    monkeypatch.setattr(Clockless, "given", {"socket": str(tmp_path / "tap.sock")})
    monkeypatch.setattr(Clockless, "watched", {"ledpi/image_raw/compressed"})

    def spin(node: Any) -> None:
        images, infos = (node.made[f"ledpi/{name}"] for name in ("image_raw/compressed", "camera_info"))
        wait_until(lambda: len(images) > 1 and len(infos) > 1)
        picture = cv2.imdecode(np.frombuffer(images[0].data, np.uint8), cv2.IMREAD_UNCHANGED)
        assert picture.shape == (48, 64)
        assert (infos[0].distortion_model, infos[0].d) == ("equidistant", [0.1, 0.02, 0.0, 0.0])
        assert vars(infos[0].header.stamp) == vars(images[0].header.stamp)
        raise sys.modules["rclpy.executors"].ExternalShutdownException

    monkeypatch.setattr(sys.modules["rclpy"], "spin", spin, raising=False)
    with pytest.raises(SystemExit) as ended:
        module.main()
    daemon.close()
    assert ended.value.code == 0


def test_a_topic_that_ros_refuses_is_one_line(
    module: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With status 2, as a person must act."""

    def refuse(self: Clockless, kind: type[Any], topic: str, depth: int) -> None:
        raise sys.modules["rclpy.exceptions"].NameValidationException(f"Invalid topic name:\n  '{topic}'\n   ^")

    monkeypatch.setattr(Clockless, "given", {"topic": "robot-1"})
    monkeypatch.setattr(Clockless, "create_publisher", refuse)
    with pytest.raises(SystemExit) as ended:
        module.main()
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("ledpi: parameters: Invalid topic name")
    assert "robot-1/image_raw" in line


def test_the_packages_files_agree() -> None:
    """Finds what is declared in one in the others; what the code imports and publishes is a dependency."""
    package = ElementTree.parse(PACKAGE / "package.xml").getroot()
    assert package.findtext("name") == "ledpi_ros"
    assert package.findtext("export/build_type") == "ament_python"
    setup = (PACKAGE / "setup.py").read_text(encoding="utf-8")
    assert f'version="{package.findtext("version")}"' in setup
    for name in ("launch/ledpi.launch.py", "config/ledpi.yaml", "config/nav2_docking.yaml", "package.xml"):
        assert f'"{name}"' in setup
        assert (PACKAGE / name).is_file()
    assert (PACKAGE / "resource/ledpi_ros").is_file()
    assert "executable=/usr/bin/env python3" in (PACKAGE / "setup.cfg").read_text(
        encoding="utf-8"
    )  # that of an environment
    sources = [path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py") if path.name != "setup.py"]
    given = yaml.safe_load((PACKAGE / "config/ledpi.yaml").read_text(encoding="utf-8"))["/**"]["ros__parameters"]
    declared = re.findall(r'declare_parameter\("(\w+)"', "".join(sources))
    assert set(declared) == set(given)
    imported = re.findall(r"^(?:from|import) (\w+)", "\n".join(sources), re.MULTILINE)
    published = re.findall(r'"(\w+)/msg/', (ROOT / "ledpi/links/ros/contents.py").read_text(encoding="utf-8"))
    wanted = {element.text for element in package.findall("exec_depend")}
    others = {*sys.stdlib_module_names, "ledpi", "ledpi_ros"}
    assert {"tf2_ros_py" if name == "tf2_ros" else name for name in {*imported, *published} - others} == wanted


def test_nav2s_docking_server_turns_nothing() -> None:
    """Its defaults (SimpleChargingDock) are an AprilTag's; our dock's x points into the panel already."""
    text = (PACKAGE / "config/nav2_docking.yaml").read_text(encoding="utf-8")
    given = yaml.safe_load(text)["docking_server"]["ros__parameters"]
    dock = given[given["dock_plugins"][0]]
    assert dock["plugin"] == "opennav_docking::SimpleChargingDock"
    assert dock["use_external_detection_pose"] is True
    assert [dock[f"external_detection_rotation_{axis}"] for axis in ("roll", "pitch", "yaw")] == [0.0] * 3
    assert dock["external_detection_translation_x"] < 0
