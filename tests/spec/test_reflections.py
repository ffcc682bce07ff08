"""Panels over a glossy floor: no reflection is read, neither as another ID nor with a pose of its own."""

from __future__ import annotations

import numpy as np
import pytest

from evaluation.simulated import GlossyFloor
from ledpi.camera.simulate.scene import Panel, Room, Scene, SimulatedSensor
from ledpi.camera.simulate.scenes import ov5647_lens
from ledpi.camera.simulate.trajectory import Still, facing_camera
from ledpi.camera.simulated import SimulatedCamera
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import Frame, PanelSpec
from ledpi.pipeline.pipeline import Pipeline
from tests.builders.decode import panel_settings

DICTIONARIES = ("DICT_4X4_50", "DICT_4X4_250", "DICT_5X5_100")
SPEC = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
PLACE = np.array([0.02, -0.09, 0.75])  # of the panel; a hand's breadth below its middle is the floor
FLOOR_M = 0.02
SUBSET = 3  # of each dictionary, beside what a mirror is known to show


def over_the_floor(dictionary: str, marker_id: int, exposure_us: float) -> Scene:
    """One panel that nearly stands on a floor, which reflects half of the light."""
    rng = np.random.default_rng(marker_id)
    pose = facing_camera(PLACE, yaw_deg=rng.uniform(-25, 25), pitch_deg=rng.uniform(-8, 8))
    codeword = load_dictionary(dictionary).codeword(marker_id)
    return Scene(
        sensor=SimulatedSensor(intrinsics=ov5647_lens(640, 480), exposure_us=exposure_us),
        panels=(Panel(codeword=codeword, spec=SPEC, motion=Still(pose), marker_id=marker_id, brightness=0.5),),
        room=Room(level=0.05),
        floor=GlossyFloor(y_m=FLOOR_M, reflectance=0.5),
    )


def read_ids(scene: Scene, *settings: str) -> list[tuple[int, bool]]:
    """The IDs that two frames show, by themselves and as a stream; and whether each is at the panel's place."""
    found = []
    camera = SimulatedCamera(scene, seed=1, paced=False)
    frames = [camera.read(np.empty((480, 640), np.uint8)) for _ in range(2)]
    for stream in (False, True):
        path = Pipeline(camera.info, panel_settings(*settings), intrinsics=scene.sensor.intrinsics, stream=stream)
        for frame in frames:
            assert isinstance(frame, Frame)
            (truth,) = camera.truth(frame.seq)
            for marker in path.decode(frame).markers:
                off_px = np.linalg.norm((marker.detection.corners_px - truth.corners_px).mean(axis=0))
                side_px = np.linalg.norm(truth.corners_px[1] - truth.corners_px[0])
                found.append((marker.detection.id, bool(off_px < 0.25 * side_px)))  # a reflection is a side away
    return found


def missed_or_misread(dictionary: str, ids: list[int], exposure_us: float) -> tuple[list[int], list[int]]:
    """IDs that exist and are not read at all; and IDs of panels beside which anything else is reported."""
    existing = panel_settings(f"panels.dictionary={dictionary}").existing_ids()
    missed, misread = [], []
    for marker_id in ids:
        found = read_ids(over_the_floor(dictionary, marker_id, exposure_us), f"panels.dictionary={dictionary}")
        if any(what != (marker_id, True) for what in found):
            misread.append(marker_id)
        if marker_id in existing and not found:
            missed.append(marker_id)
    return missed, misread


@pytest.mark.slow
@pytest.mark.parametrize("dictionary", DICTIONARIES)
def test_no_reflection_of_some_is_read(dictionary: str) -> None:
    """Those that are not another's mirror image are read, beside their reflection."""
    words = load_dictionary(dictionary)
    some = np.random.default_rng(35).permutation(len(words.codewords))[:SUBSET].tolist()
    like = list(words.reflection_like_ids())
    missed, misread = missed_or_misread(dictionary, sorted({*some, *like[:SUBSET]}), 10_000.0)
    assert misread == []
    assert len(missed) <= 1


@pytest.mark.parametrize("step", [pytest.param(40, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.nightly)])
@pytest.mark.parametrize(("exposure_us", "first"), [(10_000.0, 0), (150.0, 1)])
@pytest.mark.parametrize("dictionary", ["DICT_4X4_250", "DICT_5X5_100"])
def test_no_reflection_is_read(dictionary: str, exposure_us: float, first: int, step: int) -> None:
    """Tries a twentieth, or every ID, each second one at either exposure. DICT_4X4_250 begins with DICT_4X4_50."""
    ids = list(range(first, len(load_dictionary(dictionary).codewords), step))
    missed, misread = missed_or_misread(dictionary, ids, exposure_us)
    assert misread == []
    assert len(missed) <= max(1, len(ids) / 20)


def test_where_they_are_listed_a_mirror_shows_them() -> None:
    """Holds a scene against what a mirror would show: 124 below 70, and word 9 at the place of its reflection."""
    pair = over_the_floor("DICT_4X4_250", 70, 10_000.0)
    listed = ("panels.dictionary=DICT_4X4_250", "panels.ids=[70, 124]")
    assert {(70, True), (124, False)} <= set(read_ids(pair, *listed))
