"""Why a panel is not read, in words: of each thing that may be wrong with it, on pictures of it."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from ledpi.camera.simulate.scenes import still_scene
from ledpi.camera.simulated import SimulatedCamera, simulated_sensor
from ledpi.config.settings import Config
from ledpi.core.records import CameraInfo, Frame, RowsFrom
from ledpi.pipeline.diagnosis.diagnose import Diagnosis, NotRead, diagnose, not_read_in
from ledpi.pipeline.diagnosis.reasons import swapped
from ledpi.pipeline.diagnosis.what_if import Supposed
from ledpi.pipeline.diagnosis.why_not import RUN_FRAMES, Why, WhyNot
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pipeline.trace import Trace
from tests.builders.faults import DICTIONARY, FAULTS, PLACE_PX, RIGHT, SIDE_PX, Fault, camera_of, config_of

FRAMES = 9  # of a stream


def explained(fault: Fault, *, stream: bool) -> tuple[list[int], Why]:
    """IDs that are read, and why others are not, of the frame in which most is told."""
    config = config_of(fault)
    camera = camera_of(fault, config, paced=False)
    pipeline = Pipeline(camera.info, config.panels, intrinsics=camera.info.intrinsics, stream=stream)
    why_not = WhyNot(camera.info, config.panels, camera.info.intrinsics)
    into = np.empty((camera.info.height, camera.info.width), np.uint8)
    told: list[tuple[Frame, Trace, list[int], list[np.ndarray]]] = []
    for _ in range(FRAMES if stream else 1):
        frame, trace = camera.read(into.copy()), Trace()
        assert frame is not None
        markers = pipeline.decode(frame, trace).markers
        ids, corners = [m.detection.id for m in markers], [m.detection.corners_px for m in markers]
        told.append((frame, trace, ids, corners))
    frame, trace, ids, corners = max(told[FRAMES // 2 :] if stream else told, key=lambda one: len(one[1].dropped))
    return ids, why_not.explain(frame, not_read_in(trace), corners, [one[0] for one in told])


def at_the_panel(why: Why) -> list[Diagnosis]:
    """Returns what is told of panel 11's place."""
    return [one for one in why.diagnoses if np.abs(one.corners_px.mean(axis=0) - PLACE_PX).max() < SIDE_PX / 2]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "stream"), [(name, bool(number % 2)) for number, name in enumerate(FAULTS)])
def test_what_is_wrong_is_said_at_its_place(name: str, stream: bool) -> None:
    """First of all that is told there, with what helps; the panel is not read. In one frame, or in a stream."""
    fault = FAULTS[name]
    ids, why = explained(fault, stream=stream)
    assert 11 not in ids
    found = at_the_panel(why)
    assert found, [one.line for one in why.diagnoses]
    assert fault.says in found[0].says
    assert found[0].helps
    assert found[0].kind != "shape"


def far_panel(config: Config, *, turned: bool) -> tuple[CameraInfo, Iterator[Frame]]:
    """A camera without a lens, and its frames of a panel 4 m away, turned by 180° after read-out or not."""
    sensor = simulated_sensor(config.camera, config.panels)
    scene = still_scene(sensor, {7: config.panels.spec()}, DICTIONARY, distance_m=4.0, angle_deg=0.0)
    camera = SimulatedCamera(scene, seed=3, paced=False)

    def frames() -> Iterator[Frame]:
        while True:
            frame = camera.read(np.empty((480, 640), np.uint8))
            assert isinstance(frame, Frame)
            yield replace(frame, pixels=frame.pixels[::-1, ::-1].copy()) if turned else frame

    return replace(camera.info, rows_from=config.camera.rows_from, intrinsics=None), frames()


@pytest.mark.slow
@pytest.mark.parametrize(("turned", "configured"), [(True, "above"), (False, "below"), (False, "above")])
def test_rows_from_the_other_side_are_told_of_a_far_panel(turned: bool, configured: RowsFrom) -> None:
    """Its bands move the other way from frame to frame; one frame alone does not tell. Nothing where they fit."""
    config = config_of(RIGHT, f"camera.rows_from={configured}")
    seen_by, frames = far_panel(config, turned=turned)
    run = list(itertools.islice(frames, RUN_FRAMES))
    trace = Trace()
    assert not Pipeline(seen_by, config.panels, intrinsics=None, stream=False).decode(run[0], trace).markers
    told = WhyNot(seen_by, config.panels, None).explain(run[0], not_read_in(trace), [], run).diagnoses[0]
    other = "above" if configured == "below" else "below"
    is_wrong = turned or configured == "below"
    assert (f"this is ID 7, if the picture's rows run from {other}" in told.says) is is_wrong
    assert (told.helps == f"set camera.rows_from: {other}") is is_wrong
    assert told.kind == "panel" or not is_wrong  # a panel that is far may be any light, for all that a frame shows


def test_what_a_guess_reads_is_outlined_where_it_is_read() -> None:
    """Not where a rough square was dropped, which may lie beside it."""
    config = config_of(RIGHT)
    frame = camera_of(RIGHT, config, paced=False).read(np.empty((480, 640), np.uint8))
    assert isinstance(frame, Frame)
    panel = np.array(PLACE_PX) + SIDE_PX / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    rough = NotRead(corners_px=panel + np.array([0.3 * SIDE_PX, 0.0]), why="fit.uncertain")
    (told,) = diagnose(frame, config.panels, [rough], supposed=[Supposed(panel, swapped(11))])
    assert (told.corners_px == panel).all()


@pytest.mark.parametrize("stream", [False, True], ids=["alone", "stream"])
def test_where_all_is_well_nothing_is_told(stream: bool) -> None:
    """Shapes on the wall are no lights; the picture is bright and sharp enough."""
    ids, why = explained(RIGHT, stream=stream)
    assert sorted(ids) == [7, 11]
    assert [one.line for one in why.diagnoses if one.kind != "shape"] == []
    assert why.notes == []


@pytest.mark.slow
@pytest.mark.parametrize(("name", "says"), [("out of focus", "the picture is blurred"), ("null", "is at a null of")])
def test_what_holds_for_the_whole_picture_is_told_of_it(name: str, says: str) -> None:
    """Once, whatever is in it."""
    _, why = explained(FAULTS[name], stream=False)
    assert [says in note.says for note in why.notes] == [True]
    assert why.notes[0].helps


def test_a_dark_and_a_bright_picture_are_told() -> None:
    """Though nothing four-sided is found in them."""
    for level, says in ((2, "too dark"), (255, "too bright")):
        config = config_of(RIGHT)
        camera = camera_of(RIGHT, config, paced=False)
        frame = camera.read(np.empty((480, 640), np.uint8))
        assert isinstance(frame, Frame)
        even = Frame(
            pixels=np.full((480, 640), level, np.uint8),
            seq=0,
            row0_readout_ns=0,
            exposure_us=frame.exposure_us,
            row_time_us=frame.row_time_us,
            transfer=frame.transfer,
        )
        why = WhyNot(camera.info, config.panels, None).explain(even, [], [])
        assert [says in note.says for note in why.notes] == [True]
