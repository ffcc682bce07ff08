"""markers.yaml and WPILib's layouts: places by hand, mistakes in one line, and the same map out as in."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ledpi.config.map_yaml import BY_EYE_DEG, BY_TAPE_M, layout_text, load_layout, load_map, map_text
from ledpi.core.errors import ConfigError
from ledpi.core.records import Floats, MapPanel, PanelMap
from tests.builders.command import Run, complaint, in_process

HALF = math.sqrt(0.5)


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "markers.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def place_of(tmp_path: Path, values: str) -> Floats:
    panel: MapPanel = load_map(written(tmp_path, f"panels:\n  7: {{position_m: [4, 1, 1.5], {values}}}\n"))[7]
    return panel.map_from_marker


# Where the marker's x (right, as it is looked at), y (up) and z (out of it) point in the map.
@pytest.mark.parametrize(
    ("values", "right", "up", "out"),
    [
        ("yaw_deg: 0", (0, 1, 0), (0, 0, 1), (1, 0, 0)),
        ("yaw_deg: 180", (0, -1, 0), (0, 0, 1), (-1, 0, 0)),
        ("yaw_deg: 90", (-1, 0, 0), (0, 0, 1), (0, 1, 0)),
        ("pitch_deg: 90", (0, 1, 0), (1, 0, 0), (0, 0, -1)),  # on the ceiling, its top towards x
        ("roll_deg: 90", (0, 0, 1), (0, -1, 0), (1, 0, 0)),  # turned anticlockwise, as it is looked at
        ("quaternion_wxyz: [1, 0, 0, 0]", (1, 0, 0), (0, 1, 0), (0, 0, 1)),  # on the floor
        (f"quaternion_wxyz: [{HALF}, {HALF}, 0, 0]", (1, 0, 0), (0, 0, 1), (0, -1, 0)),
    ],
)
def test_a_panel_faces_where_the_map_says(
    tmp_path: Path, values: str, right: tuple[int, ...], up: tuple[int, ...], out: tuple[int, ...]
) -> None:
    """By angles as a person thinks of a panel on a wall, or by a quaternion, which is map_from_marker."""
    place = place_of(tmp_path, values)
    np.testing.assert_allclose(place[:3, :3], np.column_stack([right, up, out]), atol=1e-9)
    np.testing.assert_allclose(place[:3, 3], [4, 1, 1.5])


def test_size_and_deviations_are_each_panels_own(tmp_path: Path) -> None:
    """Else the file's deviations, else those of a tape measure; and the configuration's size."""
    text = """
    format: 1
    deviations: {position_m: 0.05}
    panels:
      7: {position_m: [0, 0, 1], yaw_deg: 0}
      8: {position_m: [0, 1, 1], yaw_deg: 0, side_m: 0.3, deviations: {position_m: 0.001, angle_deg: 0.1}}
    """
    panels = load_map(written(tmp_path, text))
    assert (panels[7].side_m, panels[7].position_sigma_m) == (None, 0.05)
    assert panels[7].angle_sigma_rad == pytest.approx(math.radians(BY_EYE_DEG))
    assert (panels[8].side_m, panels[8].position_sigma_m) == (0.3, 0.001)
    assert panels[8].angle_sigma_rad == pytest.approx(math.radians(0.1))
    bare = load_map(written(tmp_path, "panels: {7: {position_m: [0, 0, 1], yaw_deg: 0}}"))
    assert bare[7].position_sigma_m == BY_TAPE_M


PLACE = "position_m: [4, 1, 1.5]"
MISTAKES = [
    (f"panels:\n  7: {{{PLACE}, yaw_deg: 0}}\n  7: {{{PLACE}, yaw_deg: 0}}\n", "line 3: 7 is there twice"),
    (f"panels: {{7: {{{PLACE}, quaternion_wxyz: [0, 0, 0, 0]}}}}", "panels.7.quaternion_wxyz: is no rotation"),
    (f"panels: {{7: {{{PLACE}, quaternion_wxyz: [1, 1, 0, 0]}}}}", "panels.7.quaternion_wxyz: must have length 1"),
    ("panels: {7: {position_cm: [400, 100, 150], yaw_deg: 0}}", "position_cm: unknown key; did you mean position_m?"),
    ("panels: {7: {position_m: [4, 1], yaw_deg: 0}}", "panels.7.position_m: must be three numbers"),
    (f"units: cm\npanels: {{7: {{{PLACE}, yaw_deg: 0}}}}", "units: unknown key"),
    (f"panels: {{7: {{{PLACE}, yaw_deg: 0, side_m: 160}}}}", "panels.7.side_m: must be in metres, 10 at most"),
    (f"panels: {{7: {{{PLACE}}}}}", "panels.7: must have either quaternion_wxyz, or where it faces: yaw_deg"),
    (f"panels: {{7: {{{PLACE}, yaw_deg: yes}}}}", "panels.7.yaw_deg: takes no true or false"),
    (f"panels: {{7: {{{PLACE}, yaw_deg: 0, deviations: {{angle: 1}}}}}}", "panels.7.deviations.angle: unknown key"),
    ("panels: {7: {position_m: [4000, 1, 1.5], yaw_deg: 0}}", "position_m.0: must be less than or equal to 1000"),
    ("format: 2\npanels: {}", "format: must be 1"),
    ("panels: {}", "panels: must hold a panel at least"),
    ("", "must be a map of panels"),
]


@pytest.mark.parametrize(("text", "message"), MISTAKES)
def test_a_mistake_in_a_map_is_named(tmp_path: Path, text: str, message: str) -> None:
    """The file, the key, what is wrong and what would be right, in one line."""
    path = written(tmp_path, text)
    with pytest.raises(ConfigError) as error:
        load_map(path)
    assert str(error.value).startswith(f"{path}: ")
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def some_panels() -> PanelMap:
    turned = np.eye(4)
    turned[:3, :3] = [[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]]
    turned[:3, 3] = (1.25, -2.5, 0.75)
    return {
        3: MapPanel(map_from_marker=np.eye(4), side_m=0.16, position_sigma_m=0.002, angle_sigma_rad=0.001),
        12: MapPanel(map_from_marker=turned, position_sigma_m=0.01, angle_sigma_rad=0.02),
    }


def test_a_map_that_is_written_is_read_again(tmp_path: Path) -> None:
    """Places, sizes and deviations, rounded below what they mean."""
    panels = some_panels()
    read = load_map(written(tmp_path, map_text(panels, "two\nlines")))
    assert set(read) == {3, 12}
    for i, panel in panels.items():
        np.testing.assert_allclose(read[i].map_from_marker, panel.map_from_marker, atol=1e-5)
        assert read[i].side_m == panel.side_m
        assert read[i].position_sigma_m == pytest.approx(panel.position_sigma_m, abs=1e-5)
        assert read[i].angle_sigma_rad == pytest.approx(panel.angle_sigma_rad, abs=1e-6)


# Two tags of WPILib's own 2024 field: 7, the blue speaker's, faces along x; 4, the red one's, against it.
LAYOUT = {
    "tags": [
        {
            "ID": 4,
            "pose": {
                "translation": {"x": 16.579342, "y": 5.547868, "z": 1.451102},
                "rotation": {"quaternion": {"W": 6.123233995736766e-17, "X": 0.0, "Y": 0.0, "Z": 1.0}},
            },
        },
        {
            "ID": 7,
            "pose": {
                "translation": {"x": -0.0381, "y": 5.547868, "z": 1.451102},
                "rotation": {"quaternion": {"W": 1.0, "X": 0.0, "Y": 0.0, "Z": 0.0}},
            },
        },
    ],
    "field": {"length": 16.541, "width": 8.211},
}


def test_a_field_layout_of_wpilib_is_read(tmp_path: Path) -> None:
    """A tag's own x comes out of it and z points up, where a marker's z comes out and y points up."""
    path = tmp_path / "layout.json"
    path.write_text(json.dumps(LAYOUT))
    panels = load_layout(path)
    np.testing.assert_allclose(panels[7].map_from_marker[:3, :3], [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-9)
    np.testing.assert_allclose(panels[4].map_from_marker[:3, :3], [[0, 0, -1], [-1, 0, 0], [0, 1, 0]], atol=1e-9)
    np.testing.assert_allclose(panels[4].map_from_marker[:3, 3], [16.579342, 5.547868, 1.451102])


def test_a_field_layout_of_2027_is_read(tmp_path: Path) -> None:
    """The tags and the field have other names since then, and the panels are the same."""
    path, new = tmp_path / "layout.json", tmp_path / "new.json"
    path.write_text(json.dumps(LAYOUT))
    more = {"name": "Room", "season": "2027", "program": "frc"}
    new.write_text(json.dumps({**more, "field-dimensions": LAYOUT["field"], "field-tags": LAYOUT["tags"]}))
    was, now = load_layout(path), load_layout(new)
    assert now.keys() == was.keys()
    for marker_id, panel in was.items():
        np.testing.assert_array_equal(now[marker_id].map_from_marker, panel.map_from_marker)
    new.write_text(json.dumps({"field-tags": [{"ID": True}], "field-dimensions": LAYOUT["field"]}))
    with pytest.raises(ConfigError, match=r"field-tags\.0\.ID: takes no true or false"):
        load_layout(new)


def fiducial(marker_id: int, *place: float, cosine: float = -1.0) -> dict[str, Any]:
    """At x y z, its own x along the field's, or against it."""
    x, y, z = place
    rows = [cosine, 0, 0, x, 0, cosine, 0, y, 0, 0, 1, z, 0, 0, 0, 1]
    return {"family": "apriltag3_36h11_classic", "id": marker_id, "size": 165.1, "transform": rows, "unique": 1}


def test_a_field_map_of_limelight_is_read(tmp_path: Path) -> None:
    """The same tags as in the field layout: here from the field's middle, sizes in millimetres."""
    path = tmp_path / "field.fmap"
    fiducials = [fiducial(4, 8.308842, 1.442368, 1.451102), fiducial(7, -8.3086, 1.442368, 1.451102, cosine=1.0)]
    path.write_text(json.dumps({"type": "frc", "fiducials": fiducials}))
    panels = load_layout(path)
    np.testing.assert_allclose(panels[7].map_from_marker[:3, :3], [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-9)
    np.testing.assert_allclose(panels[4].map_from_marker[:3, :3], [[0, 0, -1], [-1, 0, 0], [0, 1, 0]], atol=1e-9)
    np.testing.assert_allclose(panels[4].map_from_marker[:3, 3], [8.308842, 1.442368, 1.451102])
    assert panels[4].side_m == pytest.approx(0.1651)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda tags: tags[1].update(id=4), "fiducials.1.id: 4 is there twice"),
        (
            lambda tags: tags[0]["transform"].pop(),
            "fiducials.0.transform: must be 16 numbers, a 4 × 4 matrix row by row",
        ),
        (lambda tags: tags[0].update(transform=[1.0] * 16), "fiducials.0.transform: must be a rotation and a place"),
        (
            lambda tags: tags[0]["transform"].__setitem__(3, 8308.8),
            "fiducials.0.transform: must have x, y and z in metres, within 1000, not [",
        ),
        (lambda tags: tags[0].update(size=0.1651), "fiducials.0.size: must be 20 to 10000 millimetres, not 0.1651"),
        (lambda tags: tags.clear(), "fiducials: must not be empty"),
    ],
)
def test_a_mistake_in_a_field_map_of_limelight_is_named(tmp_path: Path, change: Any, message: str) -> None:
    """As in a map of ours."""
    fiducials = [fiducial(4, 8.3, 1.4, 1.45), fiducial(7, -8.3, 1.4, 1.45)]
    change(fiducials)
    path = tmp_path / "field.fmap"
    path.write_text(json.dumps({"type": "frc", "fiducials": fiducials}))
    with pytest.raises(ConfigError) as error:
        load_layout(path)
    assert message in str(error.value)


def test_a_field_layout_goes_out_as_it_came_in(tmp_path: Path) -> None:
    """Every number, but for the sign that two equal quaternions may differ in."""
    path = tmp_path / "layout.json"
    path.write_text(json.dumps(LAYOUT))
    again = json.loads(layout_text(load_layout(path), (16.541, 8.211)))
    assert again["field"] == LAYOUT["field"]
    for tag, tag_again in zip(LAYOUT["tags"], again["tags"], strict=True):  # type: ignore[arg-type]
        assert tag_again["ID"] == tag["ID"]  # type: ignore[index]
        for part in ("translation",):
            assert tag_again["pose"][part] == pytest.approx(tag["pose"][part])  # type: ignore[index]
        before, after = (t["pose"]["rotation"]["quaternion"] for t in (tag, tag_again))  # type: ignore[index]
        assert abs(sum(before[k] * after[k] for k in "WXYZ")) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda layout: layout["tags"][1].update(ID=4), "tags.1.ID: 4 is there twice"),
        (lambda layout: layout["tags"][0]["pose"]["rotation"]["quaternion"].update(Z=0), "must have length 1, not 6"),
        (
            lambda layout: layout.update({"field-tags": layout["tags"]}),
            "tags and field-tags: must be one of them, not 2",
        ),
        (lambda layout: layout["tags"][0]["pose"].pop("translation"), "tags.0.pose.translation: must be given"),
        (lambda layout: layout["tags"][0].update(ID=True), "tags.0.ID: takes no true or false"),
    ],
)
def test_a_mistake_in_a_layout_is_named(tmp_path: Path, change: Any, message: str) -> None:
    """As in a map of ours."""
    layout = json.loads(json.dumps(LAYOUT))
    change(layout)
    path = tmp_path / "layout.json"
    path.write_text(json.dumps(layout))
    with pytest.raises(ConfigError) as error:
        load_layout(path)
    assert message in str(error.value)


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """`ledpi map …` in the test's folder."""
    monkeypatch.chdir(tmp_path)
    return in_process(monkeypatch, capsys, "map")


def test_map_import_and_export_keep_the_older_file(tmp_path: Path, run: Run) -> None:
    """`export`: the layout again, nothing overwritten; an ID without a word is named; what is bad changes nothing."""
    layout = tmp_path / "layout.json"
    layout.write_text(json.dumps(LAYOUT).replace('"ID": 7', '"ID": 57'))
    (tmp_path / "markers.yaml").write_text("my own")
    status, said, _ = run("import", str(layout), "markers.yaml")
    assert status == 0
    assert "2 panels" in said
    assert "57 in markers.yaml cannot be read: DICT_4X4_50 has IDs 0 to 49" in said
    assert (tmp_path / "markers.yaml.bak-1").read_text() == "my own"
    assert run("export", "markers.yaml", "out.json", "--field", "16.541", "8.211")[0] == 0
    assert [tag["ID"] for tag in json.loads((tmp_path / "out.json").read_text())["tags"]] == [4, 57]
    before = (tmp_path / "markers.yaml").read_text()
    layout.write_text("{}")
    complaint(run("import", str(layout), "markers.yaml"))
    assert (tmp_path / "markers.yaml").read_text() == before


def test_a_wrong_configuration_stops_no_import(run: Run) -> None:
    """It only tells which IDs its dictionary has; one that is named must be right."""
    Path("layout.json").write_text(json.dumps(LAYOUT))
    Path("config.yaml").write_text("panels: {side_m: 160}\n")
    status, said, _ = run("import", "layout.json", "markers.yaml")
    assert (status, Path("markers.yaml").is_file()) == (0, True)
    assert "was not looked at: config.yaml: panels.side_m: must be in metres" in said
    assert "side_m" in complaint(run("import", "layout.json", "other.yaml", "--config", "config.yaml"))


def test_a_device_is_never_put_aside_for_a_map(tmp_path: Path, run: Run) -> None:
    """An older *file* is renamed. A pipe or /dev/null in its place is not: others need it."""
    layout, pipe = tmp_path / "layout.json", tmp_path / "pipe"
    layout.write_text(json.dumps(LAYOUT))
    os.mkfifo(pipe)
    assert "pipe: is no file but a device" in complaint(run("import", str(layout), str(pipe)))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["layout.json", "pipe"]


@pytest.mark.parametrize("length", ["nan", "0"])
def test_a_field_has_a_size(run: Run, length: str) -> None:
    """JSON has no NaN, and a field of no length no place for a panel."""
    said = complaint(run("export", "markers.yaml", "--field", length, "3"))
    assert f"--field {length} 3: must be two lengths above 0" in said
