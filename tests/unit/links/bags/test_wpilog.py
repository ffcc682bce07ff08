"""A data log, as WPILib's own reader finds it."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("wpiutil.log", reason="robotpy-wpiutil (of pyntcore) is not installed")

from wpiutil.log import DataLogReader, DataLogRecord

from ledpi.camera.simulate.scenes import drive_map
from ledpi.config.map_yaml import map_text
from ledpi.links.bags.wpilog import WpilogWriter
from tests.builders.command import ledpi
from tests.unit.links.bags.conftest import OFFSET_NS


@pytest.fixture(scope="module")
def map_file(take: Path) -> Path:
    path = take.parent / "markers.yaml"
    path.write_text(map_text(drive_map(), "The drive."), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def log(take: Path, map_file: Path) -> dict[str, list[Any]]:
    """Values by entry; each is (the entry's type, time in µs, value)."""
    out = take.parent / "take.wpilog"
    done = ledpi("export", take, out, "--set", f"map={map_file}")
    assert done.returncode == 0, done.stderr
    reader = DataLogReader(str(out))
    assert reader.isValid()
    names: dict[int, tuple[str, str]] = {}
    found: dict[str, list[Any]] = {}
    for record in reader:
        if record.isStart():
            start = record.getStartData()
            names[start.entry] = (start.name, start.type)
        else:
            name, kind = names[record.getEntry()]
            found.setdefault(name, []).append((kind, record.getTimestamp(), value_of(record, kind)))
    return found


def value_of(record: DataLogRecord, kind: str) -> Any:
    """By WPILib's own code, but for a Pose3d: seven numbers."""
    if kind == "struct:Pose3d":
        return list(struct.unpack("<7d", record.getRaw()))
    read = {
        "double[]": "getDoubleArray",
        "int64[]": "getIntegerArray",
        "int64": "getInteger",
        "structschema": "getString",
    }
    return getattr(record, read[kind])()


@pytest.fixture(scope="module")
def wanted(take: Path, map_file: Path) -> list[dict[str, Any]]:
    """Returns what `ledpi decode` says."""
    return [json.loads(line) for line in ledpi("decode", take, "--set", f"map={map_file}").stdout.splitlines()]


@pytest.mark.slow
def test_poses_are_those_of_decode_in_wpilibs_frames(log: dict[str, list[Any]], wanted: list[dict[str, Any]]) -> None:
    """Camera: x ahead, y left, z up."""
    poses = log["NT:/ledpi/panels/7/pose"]
    lines = [line["markers"][0] for line in wanted if line["markers"] and line["markers"][0]["alternate"] is None]
    assert len(poses) == len(lines) > 3
    for (kind, _, (x, y, z, *turned)), marker in zip(poses, lines, strict=True):
        assert kind == "struct:Pose3d"
        np.testing.assert_allclose([-y, -z, x], marker["position_m"], atol=1e-9)
        assert np.linalg.norm(turned) == pytest.approx(1.0)


@pytest.mark.slow
def test_a_pose_and_its_deviations_have_one_time(log: dict[str, list[Any]], wanted: list[dict[str, Any]]) -> None:
    """When the panel was exposed, on the recording's own clock."""
    poses, deviations = log["NT:/ledpi/panels/7/pose"], log["NT:/ledpi/panels/7/std_devs"]
    assert [at_us for _, at_us, _ in poses] == [at_us for _, at_us, _ in deviations]
    assert {len(value) for _, _, value in deviations} == {6}
    first_ns = wanted[0]["sensor_timestamp_ns"]
    assert all(at_us * 1000 > first_ns - 10_000_000 for _, at_us, _ in poses)
    steps_us = np.diff([at_us for _, at_us, _ in log["NT:/ledpi/ids"]])
    sensor_us = np.diff([line["sensor_timestamp_ns"] for line in wanted]) / 1000
    np.testing.assert_allclose(steps_us, sensor_us, atol=1.0)


def test_ids_are_those_of_each_frame(log: dict[str, list[Any]], wanted: list[dict[str, Any]]) -> None:
    """Also where there is none."""
    ids = [value for _, _, value in log["NT:/ledpi/ids"]]
    assert ids == [[marker["id"] for marker in line["markers"]] for line in wanted]


def test_the_robot_is_there_where_there_is_a_map(log: dict[str, list[Any]], wanted: list[dict[str, Any]]) -> None:
    """In the map's frame, as it is."""
    robots = [line["robot"] for line in wanted if line["robot"] is not None]
    found = [value[:3] for _, _, value in log["NT:/ledpi/robot/pose"]]
    assert len(robots) > 0
    np.testing.assert_allclose(found, [robot["position_m"] for robot in robots], atol=1e-9)


def test_a_dashboard_is_told_what_the_bytes_mean(log: dict[str, list[Any]]) -> None:
    """Each struct has its schema, as WPILib's own have."""
    for name in ("Pose3d", "Translation3d", "Rotation3d", "Quaternion"):
        ((kind, _, schema),) = log[f"NT:/.schema/struct:{name}"]
        assert kind == "structschema"
        assert schema


def test_the_time_of_day_is_noted(log: dict[str, list[Any]], wanted: list[dict[str, Any]]) -> None:
    """In µs since 1970, beside the log's own."""
    ((kind, at_us, unix_us),) = log["systemTime"]
    assert kind == "int64"
    assert unix_us - at_us == OFFSET_NS // 1000
    assert at_us == wanted[0]["sensor_timestamp_ns"] // 1000


def test_what_was_exposed_before_the_clocks_zero_is_at_zero(tmp_path: Path) -> None:
    """A video begins at 0, when the first picture's rows had been exposed already."""
    path = tmp_path / "early.wpilog"
    with path.open("wb") as file:
        WpilogWriter(file).add("early", "int64", struct.pack("<q", 7), -5)
    assert [record.getTimestamp() for record in DataLogReader(str(path))] == [0, 0]
