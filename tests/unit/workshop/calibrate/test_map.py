"""`ledpi calibrate map`: from what a drive has seen to where the panels hang; the truth is a corridor drawn up here."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from ledpi.camera.recording.writer import RecordingWriter
from ledpi.camera.simulate.scene import Panel, Scene, SimulatedSensor
from ledpi.camera.simulate.scenes import ov5647_lens, whole_rows_us
from ledpi.camera.simulate.trajectory import Gliding, Still, facing_camera
from ledpi.camera.simulated import SimulatedCamera
from ledpi.config.map_yaml import load_map
from ledpi.config.settings import load_config
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import CalibrationError
from ledpi.core.records import Floats, MarkerPose, PanelSpec
from ledpi.pose.place import Placer
from ledpi.workshop.calibrate.map import MapCalibration, calibrate_map
from ledpi.workshop.calibrate.map_views import View, view_of
from tests.builders.command import Run, complaint
from tests.builders.decode import LENS
from tests.builders.map import SIDE_M, detection, frame, optical, panel, pose, seen_corners, with_errors

SIDES_M = dict.fromkeys(range(50), SIDE_M)
EYE = pose((0.0, 0.0, 1.2))  # the camera's mount: level, 1.2 m above the floor
MIN_SIDE_PX, MAX_OBLIQUE_DEG = 14.0, 78.0


def corridor(seed: int) -> dict[int, Floats]:
    """12 panels every 0.8 m on the walls to the left and right of 2.4 m, hung by eye."""
    rng = np.random.default_rng(seed)
    places = {}
    for k in range(12):
        wall = 1 if k % 2 == 0 else -1
        where = (0.8 * k + rng.uniform(-0.1, 0.1), 1.2 * wall, 1.2 + rng.uniform(-0.3, 0.3))
        places[k] = panel(where, -90 * wall + rng.uniform(-3, 3))
    return places


def in_sight(base: Floats, place: Floats) -> Floats | None:
    """The corners of a panel that is in the picture, large enough, and seen not too much from the side."""
    camera_from_marker = np.linalg.inv(base @ optical(EYE)) @ place
    away = camera_from_marker[:3, 3]
    facing = -camera_from_marker[:3, 2] @ away / math.hypot(*away)
    if away[2] < 0.3 or facing < math.cos(math.radians(MAX_OBLIQUE_DEG)):
        return None
    corners = seen_corners(base, place, EYE)
    (ax, ay), (bx, by) = corners[2] - corners[0], corners[3] - corners[1]
    inside = ((corners > 3) & (corners < (636, 476))).all()
    return corners if inside and abs(ax * by - ay * bx) / 2 > MIN_SIDE_PX**2 else None


@cache
def drive(seed: int) -> tuple[dict[int, Floats], tuple[View, ...]]:
    """600 frames of a drive along the corridor, swerving; each panel with the errors of fitted sides."""
    places, rng = corridor(seed), np.random.default_rng(seed)
    placer = Placer(LENS, SIDES_M, stream=True)
    views = []
    for k in range(600):
        base = pose((-2.5 + 11.5 * k / 600, 0.4 * math.sin(k / 40), 0.0), 8 * math.sin(k / 23))
        exact = {i: corners for i, place in places.items() if (corners := in_sight(base, place)) is not None}
        answers = placer.place(frame(k), [detection(i, with_errors(c, rng)) for i, c in exact.items()])
        views.append(view_of(frame(k), [answer for answer in answers if isinstance(answer, MarkerPose)]))
    return places, tuple(views)


def mapped(seed: int) -> tuple[dict[int, Floats], MapCalibration]:
    places, views = drive(seed)
    return places, calibrate_map(views, places[0], SIDES_M, LENS)


def off_by(found: Floats, true: Floats) -> tuple[float, float]:
    """Metres and degrees."""
    cosine = (np.trace(found[:3, :3] @ true[:3, :3].T) - 1) / 2
    return float(np.linalg.norm(found[:3, 3] - true[:3, 3])), math.degrees(math.acos(max(-1.0, min(1.0, cosine))))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_corridor_of_twelve_panels_is_placed(seed: int) -> None:
    """Each within 2 cm and 0.5 % of its distance from the origin panel, and 1°; and within 4 of its deviations.

    Of these the origin's, which is held, is the least, and that of the chain's end much larger.
    """
    places, result = mapped(seed)
    assert set(result.panels) == set(places)
    assert (result.origin, result.unconnected) == (0, ())
    for i, place in places.items():
        away_m, turned_deg = off_by(result.panels[i].map_from_marker, place)
        distance_m = float(np.linalg.norm(place[:3, 3] - places[0][:3, 3]))
        assert away_m < 0.02 + 0.005 * distance_m
        assert turned_deg < 1.0
        assert away_m < 4 * math.sqrt(3) * result.panels[i].position_sigma_m
    assert result.panels[0].position_sigma_m < 0.003
    assert result.panels[11].position_sigma_m > 3 * result.panels[0].position_sigma_m


@pytest.mark.slow
def test_panels_that_are_known_to_hang_upright_keep_the_map_level() -> None:
    """Lower right corners seen 0.3 px too low bend the chain; with that knowledge it bends less."""
    places, views = drive(1)
    low = np.array([[0, 0], [0, 0], [0, 0.3], [0, 0]])
    bent = [tuple(replace(p, corners_px=p.corners_px + low) for p in view) for view in views]
    off = []
    for upright in (False, True):
        result = calibrate_map(bent, places[0], SIDES_M, LENS, upright=upright)
        off.append(max(abs(result.panels[i].map_from_marker[2, 3] - places[i][2, 3]) for i in places))
    assert off[1] < 0.75 * off[0]


@pytest.mark.slow
def test_a_view_that_something_stood_before_does_not_bend_the_map() -> None:
    """Every twelfth panel's view is off by some pixels: they are named as contradicted, and the map holds."""
    places, views = drive(1)
    rng = np.random.default_rng(9)
    spoilt, count = [], 0
    for view in views:
        panels = list(view)
        for k, seen in enumerate(panels):
            count += 1
            if count % 12 == 0:
                off = seen.corners_px + np.vstack([np.zeros((2, 2)), rng.uniform(3, 8, (2, 2))])
                panels[k] = replace(seen, corners_px=off)
        spoilt.append(tuple(panels))
    result = calibrate_map(spoilt, places[0], SIDES_M, LENS)
    assert 0.04 < result.adjusted.outliers < 0.12
    for i, place in places.items():
        distance_m = float(np.linalg.norm(place[:3, 3] - places[0][:3, 3]))
        assert off_by(result.panels[i].map_from_marker, place)[0] < 0.02 + 0.005 * distance_m


@pytest.mark.slow
def test_a_panel_that_is_never_seen_with_another_is_left_out() -> None:
    """And named: the corridor's last."""
    places, views = drive(1)
    without = [tuple(panel for panel in view if panel.id != 11) for view in views]
    alone = [tuple(panel for panel in view if panel.id == 11) for view in views]
    result = calibrate_map(without + alone, places[0], SIDES_M, LENS)
    assert result.unconnected == (11,)
    assert set(result.panels) == set(places) - {11}


def test_a_drive_that_shows_one_panel_at_a_time_gives_no_map() -> None:
    """Nothing tells how panels hang to each other; and an origin must be one of those that do."""
    places, views = drive(1)
    with pytest.raises(CalibrationError, match="no frame shows two panels"):
        calibrate_map([view[:1] for view in views], places[0], SIDES_M, LENS)
    with pytest.raises(CalibrationError, match="--origin 40: no frame shows it together with another; these are: 0, 1"):
        calibrate_map(views, places[0], SIDES_M, LENS, origin=40)


# ---- The command, on rendered frames

SPEC = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
WALL = {7: (-0.3, 0.05, 1.1), 12: (0.0, -0.1, 1.2), 23: (0.35, 0.0, 1.15)}  # x right, y down, z ahead
YAWS_DEG = {7: 8.0, 12: 0.0, 23: -12.0}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """30 frames along a wall with three panels."""
    folder = tmp_path_factory.mktemp("take") / "drive"
    sensor = SimulatedSensor(intrinsics=ov5647_lens(), exposure_us=whole_rows_us(10000, 33.67), row_time_us=33.67)
    words = load_dictionary("DICT_4X4_50")
    panels = tuple(
        Panel(
            codeword=words.codeword(i),
            spec=SPEC,
            motion=Still(facing_camera(np.array(place), yaw_deg=YAWS_DEG[i])),
            marker_id=i,
        )
        for i, place in WALL.items()
    )
    start = np.eye(4)
    start[0, 3] = -0.12
    motion = Gliding(start=start, velocity_m_s=np.array([0.5, 0.0, 0.1]), start_s=1.0)
    camera = SimulatedCamera(Scene(sensor=sensor, panels=panels, camera_motion=motion), seed=2, paced=False, frames=30)
    pixels = np.empty((480, 640), np.uint8)
    with RecordingWriter(folder, camera=camera.info, dictionary="DICT_4X4_50", panel=SPEC, note="") as writer:
        while (seen := camera.read(pixels)) is not None:
            writer.write(seen, camera.truth(seen.seq))
    return folder


@pytest.fixture
def command(ledpi: Run) -> Run:
    return partial(ledpi, "calibrate", "map")


@pytest.mark.slow
def test_the_command_writes_a_map_and_a_picture(recording: Path, tmp_path: Path, command: Run) -> None:
    """Places within 2 cm of the scene's, laid from panel 12; older files are kept, a failure changes none."""
    (tmp_path / "markers.yaml").write_text("by hand")
    options = ("--origin", "12", "--position", "2", "0", "1", "--yaw-deg", "180")
    status, out, err = command(recording, *options)
    assert (status, err) == (0, "")
    panels = load_map(tmp_path / "markers.yaml")
    assert set(panels) == {7, 12, 23}
    for i, (x, y, z) in WALL.items():
        # Panel 12 looks back along the scene's z, so the map's x is the scene's z, its y points left, its z up.
        expected = np.array([2 + z - 1.2, -x, 1 - (y + 0.1)])
        np.testing.assert_allclose(panels[i].map_from_marker[:3, 3], expected, atol=0.02)
        assert panels[i].side_m == 0.16
        assert 0 < panels[i].position_sigma_m < 0.02
    assert (tmp_path / "markers.yaml.bak-1").read_text() == "by hand"
    assert (tmp_path / "markers.png").read_bytes().startswith(b"\x89PNG")
    assert "the origin" in out
    before = (tmp_path / "markers.yaml").read_bytes()
    assert "these are: 7, 12, 23" in complaint(command(recording, "--origin", "3"))
    assert (tmp_path / "markers.yaml").read_bytes() == before


@pytest.mark.slow
def test_a_configuration_without_a_map_gets_its_name(recording: Path, tmp_path: Path, command: Run) -> None:
    """So that the daemon reads it; one that names a map keeps that, and it is said which."""
    (tmp_path / "config.yaml").write_text("panels: {side_m: 0.16}  # mine\nmap: null\n")
    assert "config.yaml: map: markers.yaml written" in command(recording)[1]
    assert load_config(tmp_path / "config.yaml").map == tmp_path / "markers.yaml"
    out = command(recording, "--out", "other.yaml")[1]
    assert f"names another map, {tmp_path / 'markers.yaml'}; to use this one: map: " in out


@pytest.mark.parametrize("place", [("--position", "nan", "0", "0"), ("--yaw-deg", "inf")])
def test_an_origin_is_somewhere(place: tuple[str, ...], command: Run) -> None:
    """Before the recording is looked at."""
    assert complaint(command("nowhere", *place)) == "ledpi: --position, --yaw-deg: must be finite numbers"
