"""The ROS 2 package: its node with stand-ins for rclpy, and its files."""

from __future__ import annotations

import ast
import sys
import time
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

pytest.importorskip("rosbags", reason="rosbags is not installed")

from rosbags.interfaces import Nodetype

from ledpi.ros.types import types as store
from tests.builders import ROOT
from tests.builders.made_up_daemon import MadeUpDaemon
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

    def create_publisher(self, kind: type[Any], topic: str, depth: int) -> Any:
        self.made[topic] = []
        return types.SimpleNamespace(publish=self.made[topic].append)

    def get_logger(self) -> Any:
        return types.SimpleNamespace(warning=lambda *_, **__: None)


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    alive = [True]
    rclpy = types.ModuleType("rclpy")
    rclpy.ok = lambda: alive[0]  # type: ignore[attr-defined]
    node = types.ModuleType("rclpy.node")
    node.Node = Clockless  # type: ignore[attr-defined]
    utilities = types.ModuleType("rosidl_runtime_py.utilities")
    utilities.get_message = get_message  # type: ignore[attr-defined]
    for name, stand_in in (
        ("rclpy", rclpy),
        ("rclpy.node", node),
        ("rosidl_runtime_py", types.ModuleType("rosidl_runtime_py")),
        ("rosidl_runtime_py.utilities", utilities),
    ):
        monkeypatch.setitem(sys.modules, name, stand_in)
    monkeypatch.syspath_prepend(str(PACKAGE))
    for name in ("ledpi_ros", "ledpi_ros.node", "ledpi_ros.filling"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    import importlib

    yield importlib.import_module("ledpi_ros.node")
    alive[0] = False


def test_the_node_publishes_what_the_tap_tells(module: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pose, TF, detections, dock and diagnostics, with the messages' own fields; then that the daemon is gone."""
    daemon = MadeUpDaemon(tmp_path / "tap.sock", numbered=True)
    monkeypatch.setattr(Clockless, "given", {"socket": str(tmp_path / "tap.sock"), "dock_id": 7})
    node = module.LedpiNode()
    topics = {"/ledpi/detections", "/ledpi/panel_7", "/tf", "/detected_dock_pose", "/diagnostics"}
    wait_until(lambda: set(node.made) >= topics and len(node.made["/tf"]) > 2)
    pose = node.made["/ledpi/panel_7"][0]
    assert pose.kind == "geometry_msgs/msg/PoseWithCovarianceStamped"
    assert pose.header.frame_id == "camera_optical_frame"
    assert (pose.pose.pose.position.z, len(pose.pose.covariance)) == (2.0, 36)
    assert abs(pose.header.stamp.sec - time.time()) < 60
    (transform,) = node.made["/tf"][0].transforms
    assert (transform.kind, transform.child_frame_id) == ("geometry_msgs/msg/TransformStamped", "panel_7")
    (status,) = node.made["/diagnostics"][-1].status
    assert (status.level, status.message) == (b"\0", "running")
    assert np.isclose(node.made["/ledpi/detections"][0].detections[0].results[0].hypothesis.score, 1.0)
    daemon.close()
    wait_until(lambda: node.made["/diagnostics"][-1].status[0].message == "no daemon")


def test_the_packages_files_agree() -> None:
    """Finds what is declared in one in the others."""
    package = ElementTree.parse(PACKAGE / "package.xml").getroot()
    assert package.findtext("name") == "ledpi_ros"
    assert package.findtext("export/build_type") == "ament_python"
    setup = (PACKAGE / "setup.py").read_text(encoding="utf-8")
    assert f'version="{package.findtext("version")}"' in setup
    for name in ("launch/ledpi.launch.py", "config/ledpi.yaml", "package.xml"):
        assert f'"{name}"' in setup
        assert (PACKAGE / name).is_file()
    assert (PACKAGE / "resource/ledpi_ros").is_file()
    ast.parse((PACKAGE / "launch/ledpi.launch.py").read_text(encoding="utf-8"))
    given = yaml.safe_load((PACKAGE / "config/ledpi.yaml").read_text(encoding="utf-8"))["ledpi"]["ros__parameters"]
    node = (PACKAGE / "ledpi_ros/node.py").read_text(encoding="utf-8")
    assert all(f'"{key}"' in node or f"'{key}'" in node for key in given)
    wanted = {element.text for element in package.findall("exec_depend")}
    assert {"rclpy", "vision_msgs", "tf2_msgs", "geometry_msgs", "diagnostic_msgs"} <= wanted
