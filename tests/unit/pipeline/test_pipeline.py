"""The path of one frame, from picture to pose, alone and in a stream: painted panels, and whole simulated scenes."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import cv2
import numpy as np
import pytest

from ledpi.camera.simulate.scene import Panel, Scene, SimulatedSensor
from ledpi.camera.simulate.scenes import drive_scene, ov5647_lens
from ledpi.camera.simulate.trajectory import Gliding, facing_camera
from ledpi.camera.simulated import SimulatedCamera
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import ConfigError
from ledpi.core.geometry import matrix_from_quaternion, transform
from ledpi.core.records import Decoded, Floats, Frame, Intrinsics, MapPanel, MarkerPose, PanelSpec, PanelValues, Pixels
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pipeline.trace import Trace
from ledpi.pose.fix import Robot
from tests.builders.decode import (
    FRAME_ROWS,
    PINHOLE,
    ROW_TIME_US,
    SHORT_US,
    SPEC,
    TRUE_10_MS_US,
    Bits,
    Canvas,
    camera_info,
    diffuser,
    panel_settings,
    square,
    word,
)

PERIOD_US = FRAME_ROWS * ROW_TIME_US
NEAR, FAR = square(310.3, 240.6, 100, 4), square(310.3, 240.6, 45, 4)  # FAR takes more than one frame to read


def pipeline(*overrides: str, stream: bool = False, lens: Intrinsics | None = PINHOLE) -> Pipeline:
    return Pipeline(camera_info(), panel_settings(*overrides), intrinsics=lens, stream=stream)


def frame_of(*panels: tuple[Floats, Bits], seq: int = 0, period_us: float = PERIOD_US, light: float = 0.4) -> Frame:
    """Frame `seq` of panels whose oscillators run on from frame to frame."""
    canvas = Canvas()
    for corners, cells in panels:
        canvas.panel(corners, cells, light=light, start_us=seq * period_us)
    return dataclasses.replace(canvas.frame(seq, seq=seq), row0_readout_ns=round(1e9 + 1e3 * seq * period_us))


def lit_frame(corners: Floats, seq: int) -> Frame:
    """The same panel, lit as before, but blinking no more."""
    canvas = Canvas()
    canvas.lamp(corners, profile=diffuser)
    return canvas.frame(seq, seq=seq)


def ids(decoded: Decoded) -> list[int]:
    return sorted(marker.detection.id for marker in decoded.markers)


def ids_of(path: Pipeline, frames: Iterable[Frame]) -> list[list[int]]:
    return [ids(path.decode(frame)) for frame in frames]


def keys(decoded: Decoded) -> list[str]:
    return sorted(rejected.key for rejected in decoded.rejected)


# ---- One frame


@pytest.mark.parametrize("quarter_turns", range(4))
def test_corners_are_the_markers_own(quarter_turns: int) -> None:
    """The first is the marker's top left, as its ID is drawn, whichever way up the panel hangs."""
    (marker,) = pipeline().decode(frame_of((NEAR, word(7, quarter_turns)))).markers
    assert marker.detection.id == 7
    expected = np.roll(NEAR, -quarter_turns, axis=0)
    np.testing.assert_allclose(marker.detection.corners_px, expected, atol=0.3)


def test_the_pose_is_camera_from_marker() -> None:
    """Panel of 16 cm, upright, 1 m ahead and off to the side: 102.4 px at this focal length."""
    corners = square(319.5 + 64.0, 239.5 - 32.0, 102.4)
    (marker,) = pipeline().decode(frame_of((corners, word(7)))).markers
    assert marker.solution is not None
    pose = marker.solution.camera_from_marker
    np.testing.assert_allclose(pose.position_m, [0.1, -0.05, 1.0], atol=0.01)
    upright = np.abs(pose.quaternion_wxyz)  # half a turn about the camera's x: the marker's y is up, its z looks back
    np.testing.assert_allclose(upright, [0, 1, 0, 0], atol=0.1)


def test_the_time_is_that_of_the_panels_centre_row() -> None:
    """Row 0's read-out, plus the rows above the panel's centre, less half of the exposure."""
    frame = frame_of((NEAR, word(7)), seq=3)
    (marker,) = pipeline().decode(frame).markers
    expected_us = 1e6 + 3 * PERIOD_US + 240.6 * ROW_TIME_US - TRUE_10_MS_US / 2
    assert marker.mid_exposure_ns == pytest.approx(expected_us * 1e3, abs=2e4)


def test_the_frames_own_values_are_passed_on() -> None:
    """Number, time and the clock's offset, and its own exposure; and each stage's time, in the order of the path."""
    canvas = Canvas(exposure_us=SHORT_US)
    canvas.panel(NEAR, word(12))
    frame = dataclasses.replace(canvas.frame(seq=5), host_offset_ns=123)
    decoded = pipeline(lens=None).decode(frame)
    assert ids(decoded) == [12]
    assert decoded.markers[0].solution is None  # without intrinsics nothing is known of where it is
    assert (decoded.seq, decoded.row0_readout_ns, decoded.host_offset_ns) == (5, frame.row0_readout_ns, 123)
    decoded = pipeline().decode(frame)
    assert list(decoded.stage_ms) == ["find", "fit", "cells", "identify", "pose"]
    assert all(milliseconds > 0 for milliseconds in decoded.stage_ms.values())
    assert decoded.robot is None


def test_a_panel_moves_from_where_it_was_read() -> None:
    """A square that was not read may have been fitted a part of a cell beside: no velocity, where it is read first."""
    stream, here, beside, unknown = pipeline(stream=True), square(320, 240, 100), square(320, 230, 100), word(7)
    unknown[0], unknown[3] = unknown[3].copy(), unknown[0].copy()
    assert not stream.decode(frame_of((beside, unknown))).markers
    first, then = (stream.decode(frame_of((here, word(7)), seq=seq)).markers[0].detection for seq in (1, 2))
    assert first.velocity_px_s is None
    assert then.velocity_px_s is not None
    assert np.abs(then.velocity_px_s).max() < 100.0  # 10 px in a frame would be 600 px/s


def turned_by(yaw_deg: float) -> Floats:
    """(3, 3) orientation of a panel that faces the camera but for this."""
    return np.asarray(cv2.Rodrigues(np.array([0, np.radians(yaw_deg), 0]))[0] @ np.diag([1.0, -1.0, -1.0]))


def third_of(yaw_deg: float) -> MarkerPose:
    """Pose in the third of a stream's frames, 3.6 m before a panel that is turned by so much."""
    square_m = 0.08 * np.array([[-1.0, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
    points = square_m @ turned_by(yaw_deg).T + (0.01, 0.02, 3.6)
    seen = points[:, :2] / points[:, 2:] * PINHOLE.fx + (PINHOLE.cx, PINHOLE.cy)
    stream = pipeline(stream=True)
    decoded = [stream.decode(frame_of((seen, word(7)), seq=seq)) for seq in range(3)]
    return decoded[-1].markers[0]


@pytest.mark.parametrize("yaw_deg", [2, 5])
def test_where_a_pose_lies_between_both_its_deviations_include_them(yaw_deg: float) -> None:
    """Turned by so little, corners fit no two poses: the one that is best lies half way to the mirror image."""
    marker = third_of(yaw_deg)
    assert marker.solution is not None
    pose = marker.solution.camera_from_marker
    assert pose.covariance is not None
    for side in (-1, 1):
        off = cv2.Rodrigues(turned_by(side * yaw_deg) @ matrix_from_quaternion(pose.quaternion_wxyz).T)[0][:, 0]
        assert off @ np.linalg.solve(pose.covariance[3:, 3:], off) < 7.8  # 95 of 100 of three dimensions


def test_where_two_poses_fit_both_are_given() -> None:
    """3.6 m away and turned by 12°: to which side cannot be told. Of one turned by 40° it can."""
    facing, turned = third_of(12), third_of(40)
    assert facing.solution is not None
    assert facing.alternate is not None
    assert facing.solution.reprojection_px <= facing.alternate.reprojection_px
    assert turned.alternate is None


@pytest.mark.parametrize(("height", "width"), [(1, 1), (8, 8)])
@pytest.mark.parametrize("exposure_us", [SHORT_US, TRUE_10_MS_US])
def test_nor_has_one_that_is_too_small_for_any(height: int, width: int, exposure_us: float) -> None:
    """As a recording's may be, down to one pixel."""
    camera = dataclasses.replace(camera_info(exposure_us=exposure_us), width=width, height=height)
    frame = dataclasses.replace(Canvas(exposure_us=exposure_us).frame(), pixels=np.full((height, width), 99, np.uint8))
    for stream in (False, True):
        assert Pipeline(camera, panel_settings(), intrinsics=None, stream=stream).decode(frame).markers == ()


def test_what_was_dropped_is_counted_by_stage_and_reason() -> None:
    """A steady lamp shows no bands, where a trace says; a panel at the border is not even tried; another is read."""
    canvas, trace = Canvas(), Trace()
    canvas.panel(square(150, 150, 100), word(7))
    canvas.lamp(square(450, 300, 100))
    canvas.panel(square(20, 400, 80), word(7))
    decoded = pipeline().decode(canvas.frame(), trace)
    assert ids(decoded) == [7]
    assert {"fit.no_bands", "find.at_picture_border"} <= set(keys(decoded))
    where = [dropped.corners_px.mean(axis=0) for dropped in trace.dropped if dropped.why.reason == "no_bands"]
    np.testing.assert_allclose(where, [[450, 300]], atol=1)


@pytest.mark.parametrize("places", [2, 5])
def test_one_id_in_several_places_is_in_none(places: int) -> None:
    """Which of them is the one on the map cannot be told; the panel beside them is not affected."""
    shown = [(square(90 + 230 * (n % 3), 100 + 250 * (n // 3), 90 + 8 * n), word(7, n % 4)) for n in range(places)]
    decoded = pipeline().decode(frame_of(*shown, (square(550, 350, 90), word(23))))
    assert ids(decoded) == [23]
    assert keys(decoded).count("suppression.same_id") == places


def touched_frame(corners: Floats, seq: int = 0, sheet: float = 0.3) -> Frame:
    """A panel between a sheet as bright as the rim of its cells and a window, both along the whole of a side."""
    canvas = Canvas()
    across = corners[[1, 2]].mean(axis=0) - corners[[0, 3]].mean(axis=0)
    canvas.lamp(corners - across, sheet)
    canvas.lamp(corners + across, 0.6)
    canvas.panel(corners, word(7), start_us=seq * PERIOD_US)
    return canvas.frame(seq, seq=seq)


@pytest.mark.parametrize(("wide", "light"), [(0.04, 0.6), (0.1, 0.2)])
def test_what_is_found_first_around_a_panel_and_cannot_be_read_does_not_hide_it(wide: float, light: float) -> None:
    """A bezel, in a bright room: brighter than the panel, which is told from it at the second search, or dimmer."""
    panel = square(310.4, 240.2, 60, 13)
    canvas = Canvas(background=0.12)
    canvas.lamp(square(310.4, 240.2, (1 + 2 * wide) * 60, 13), light)
    canvas.panel(panel, word(7))
    decoded = pipeline().decode(canvas.frame(1))
    assert ids(decoded) == [7]
    np.testing.assert_allclose(decoded.markers[0].detection.corners_px, panel, atol=0.5)


@pytest.mark.slow
@pytest.mark.parametrize(("sheet", "turn_deg"), [(0.15, 4.0), (0.35, 41.0)])
def test_nor_does_it_where_the_panel_fills_half_the_picture(turn_deg: float, sheet: float) -> None:
    """At 0.45 m. The middles of its cells are bright squares by themselves, and cells beside it are out of sight.

    It, too, may seem to reach a hundredth further.
    """
    near = square(280.3, 200.6, 232, turn_deg)
    (marker,) = pipeline().decode(touched_frame(near, sheet=sheet)).markers
    assert marker.detection.id == 7
    np.testing.assert_allclose(marker.detection.corners_px, near, atol=2.3)


# ---- What the panels are


def test_an_override_by_id_changes_that_panels_size() -> None:
    """The same picture of a panel twice as large: twice as far away. Others stay as they are."""
    frame = frame_of((square(200, 200, 90), word(7)), (square(400, 250, 90), word(23)))

    def distances(path: Pipeline) -> dict[int, float]:
        found = {m.detection.id: m.solution for m in path.decode(frame).markers}
        return {i: float(s.camera_from_marker.position_m[2]) for i, s in found.items() if s is not None}

    plain, larger = distances(pipeline()), distances(pipeline("panels.overrides={7: {side_m: 0.32}}"))
    assert larger[7] == pytest.approx(2 * plain[7], rel=1e-3)
    assert larger[23] == pytest.approx(plain[23], rel=1e-3)


def test_an_override_by_id_changes_that_panels_frequencies() -> None:
    """7 blinks at 1450 and 2050 Hz, 23 as all others; each is read at its own, and only with the override."""
    other = dataclasses.replace(SPEC, black_hz=1450.0, white_hz=2050.0)
    canvas = Canvas()
    canvas.panel(square(180, 200, 110), word(7), spec=other)
    canvas.panel(square(430, 250, 110), word(23))
    frame = canvas.frame()
    assert ids(pipeline("panels.overrides={7: {black_hz: 1450, white_hz: 2050}}").decode(frame)) == [7, 23]
    assert ids(pipeline().decode(frame)) == [23]


def test_a_recordings_own_panel_values_override_the_configurations() -> None:
    """Size, frequencies and dictionary are those of the source; an override by ID still counts."""
    canvas = Canvas()
    canvas.panel(NEAR, word(7), spec=dataclasses.replace(SPEC, black_hz=1450.0, white_hz=2050.0))
    shown = PanelValues(dictionary="DICT_4X4_100", side_m=0.32, black_hz=1450.0, white_hz=2050.0, duty=0.5)

    def distance(*overrides: str) -> float:
        settings = panel_settings("panels.side_m=0.1", *overrides)
        path = Pipeline(camera_info(), settings, intrinsics=PINHOLE, source_panel=shown, stream=False)
        (marker,) = path.decode(canvas.frame()).markers
        assert marker.detection.id == 7
        assert marker.solution is not None
        return float(marker.solution.camera_from_marker.position_m[2])

    assert distance() == pytest.approx(0.32 / 100 * PINHOLE.fx, rel=0.01)
    assert distance("panels.overrides={7: {side_m: 0.64}}") == pytest.approx(2 * distance(), rel=1e-3)


def test_values_that_contradict_each_other_are_refused() -> None:
    """A recording's 1450 Hz for black cells, with an override that gives panel 7's white ones the same."""
    shown = PanelValues(dictionary="DICT_4X4_50", side_m=0.16, black_hz=1450.0, white_hz=2050.0, duty=0.5)
    settings = panel_settings("panels.overrides={7: {white_hz: 1450}}")
    with pytest.raises(ConfigError, match="own panel, of 1450 and 2050 Hz: black_hz and white_hz must differ"):
        Pipeline(camera_info(), settings, intrinsics=None, source_panel=shown)


# ---- A frame alone, and in a stream


def test_in_a_stream_frames_add_up() -> None:
    """A far panel that no single frame shows surely is read after a few, and stays read, ever more surely."""
    frames = [frame_of((square(310.3, 240.6, 38, 4), word(7)), seq=n, light=0.08) for n in range(12)]
    assert ids_of(pipeline(stream=False), frames) == [[]] * 12
    path = pipeline(stream=True)
    decoded = [path.decode(frame) for frame in frames]
    assert [ids(d) for d in decoded[4:]] == [[7]] * 8
    last, before = decoded[11].markers[0].detection, decoded[5].markers[0].detection
    assert last.margin > before.margin
    assert last.frames_used > before.frames_used > 1


def test_the_same_picture_again_is_no_new_evidence() -> None:
    """A camera that hangs delivers one picture for ever: it is no surer than once."""
    frame = frame_of((FAR, word(7)), light=0.1)
    repeated = [
        dataclasses.replace(frame, seq=n, row0_readout_ns=frame.row0_readout_ns + round(1e3 * n * PERIOD_US))
        for n in range(12)
    ]
    assert ids_of(pipeline(stream=True), repeated) == [[]] * 12


@pytest.mark.slow
@pytest.mark.parametrize("corners", [NEAR, square(310.3, 240.6, 75, 4)])
def test_frozen_phases_make_a_stream_no_worse_than_single_frames(corners: Floats) -> None:
    """At 20 ms both classes advance by whole cycles, so that every frame shows the same bands."""
    frames = [frame_of((corners, word(7)), seq=n, period_us=20_000.0) for n in range(8)]
    alone = sum(map(len, ids_of(pipeline(stream=False), frames)))
    together = ids_of(pipeline(stream=True), frames)
    assert sum(map(len, together)) >= alone
    assert alone > 0
    assert {i for found in together for i in found} == {7}


def off_frame(corners: Floats, seq: int, spec: PanelSpec, marker_id: int = 7, light: float = 0.2) -> Frame:
    """Frame `seq` of a panel of these frequencies."""
    canvas = Canvas()
    canvas.panel(corners, word(marker_id), light=light, spec=spec, start_us=seq * PERIOD_US)
    return dataclasses.replace(canvas.frame(seq, seq=seq), row0_readout_ns=round(1e9 + 1e3 * seq * PERIOD_US))


@pytest.mark.slow
@pytest.mark.parametrize(("black_hz", "white_hz"), [(1262.0, 2431.0), (1240.0, 2470.0)])
@pytest.mark.parametrize(("side_px", "frames"), [(100, 2), (38, 12)])
def test_oscillators_that_are_off_are_found_out(black_hz: float, white_hz: float, side_px: int, frames: int) -> None:
    """By 1 %: near by, each frame is read by itself; further off, frames add up at the frequencies that they tell."""
    corners = square(310.3, 240.6, side_px, 4)
    spec = dataclasses.replace(SPEC, black_hz=black_hz, white_hz=white_hz)
    path = pipeline("panels.search_frequencies=true", stream=True)
    found = ids_of(path, [off_frame(corners, n, spec) for n in range(18)])
    assert found[frames:] == [[7]] * (18 - frames)
    told = path.likelihood.off_frequency[7]
    assert (told.black_hz, told.white_hz) == pytest.approx((black_hz, white_hz), abs=2.0)


@pytest.mark.slow
def test_of_an_oscillator_that_is_off_the_phase_may_stand_still() -> None:
    """1237.5 Hz advance by 21.0 cycles a frame: frames tell the white class's frequency, their mean shows the black."""
    spec = dataclasses.replace(SPEC, black_hz=1237.5, white_hz=2431.0)
    path = pipeline("panels.search_frequencies=true", stream=True)
    found = ids_of(path, [off_frame(square(310.3, 240.6, 50, 4), n, spec, light=0.4) for n in range(24)])
    assert found[12:] == [[7]] * 12
    assert path.likelihood.off_frequency == {}  # of one of them it is only known that it stands still


@pytest.mark.slow
@pytest.mark.parametrize("side_px", [100, 38])
def test_frequencies_that_were_found_are_of_one_panel(side_px: int) -> None:
    """Another one in its place, which blinks as announced, is read as such, and not reported as off."""
    corners = square(310.3, 240.6, side_px, 4)
    off = dataclasses.replace(SPEC, black_hz=1262.0, white_hz=2431.0)
    path = pipeline("panels.search_frequencies=true", stream=True)
    shown = [(7, off)] * 20 + [(23, SPEC)] * 20
    found = ids_of(path, [off_frame(corners, n, spec, marker_id) for n, (marker_id, spec) in enumerate(shown)])
    assert (found[19], found[-1]) == ([7], [23])
    assert list(path.likelihood.off_frequency) == [7]


@pytest.mark.slow
def test_a_panel_that_blinks_as_announced_is_not_tuned() -> None:
    """However far it is, where other frequencies are sought."""
    path = pipeline("panels.search_frequencies=true", stream=True)
    found = ids_of(path, [frame_of((square(310.3, 240.6, 38, 4), word(7)), seq=n, light=0.1) for n in range(24)])
    assert found[12:] == [[7]] * 12
    assert path.likelihood.off_frequency == {}


@pytest.mark.slow
@pytest.mark.parametrize("corners", [NEAR, FAR])
def test_a_panel_that_stops_blinking_is_not_reported(corners: Floats) -> None:
    """Its driver hangs with all cells lit: from that frame on there is no marker, however many showed one before."""
    path = pipeline(stream=True)
    frames = [frame_of((corners, word(7)), seq=n) for n in range(10)] + [lit_frame(corners, n) for n in range(10, 14)]
    found = ids_of(path, frames)
    assert found[9] == [7]
    assert found[10:] == [[]] * 4


def test_a_tracked_panel_is_sought_in_its_neighbourhood() -> None:
    """Two of three frames that show it where it was expected do not search the picture at all."""
    path = pipeline(stream=True)
    decoded = [path.decode(frame_of((NEAR, word(7)), seq=n)) for n in range(10)]
    searched = [d.stage_ms["find"] > 0 for d in decoded]
    assert searched == [True, False, False] * 3 + [True]
    assert [ids(d) for d in decoded] == [[7]] * 10


@pytest.mark.parametrize("appears", [4, 6])
def test_a_newcomer_is_found_within_three_frames(appears: int) -> None:
    """While another panel is tracked, whichever frame it comes in."""
    path = pipeline(stream=True)
    late = square(500, 150, 90)
    found = [
        ids(path.decode(frame_of((NEAR, word(7)), *[(late, word(23))] * (n >= appears), seq=n)))
        for n in range(appears + 3)
    ]
    assert found[appears + 2] == [7, 23]


def test_a_followed_panel_does_not_wait_for_the_search() -> None:
    """It is handed out before the picture is searched, a newcomer after that; each once, with the fix as it is then."""
    one, other = (NEAR, word(7)), (square(500, 150, 90), word(23))
    places = {m.detection.id: m.solution for m in pipeline().decode(frame_of(one, other)).markers}
    panels = {
        marker_id: MapPanel(
            map_from_marker=transform(
                matrix_from_quaternion(solution.camera_from_marker.quaternion_wxyz),
                solution.camera_from_marker.position_m,
            )
        )
        for marker_id, solution in places.items()
        if solution is not None
    }
    robot = Robot(base_link_from_camera=np.eye(4), panels=panels)
    path = Pipeline(camera_info(), panel_settings(), intrinsics=PINHOLE, robot=robot)
    said = []
    for n in range(8):
        news: list[Decoded] = []
        decoded = path.decode(frame_of(one, *[other] * (n >= 4), seq=n), on_partial=news.append)
        said.append([(ids(part), part.stage_ms["find"] > 0, part.robot and part.robot.panels_used) for part in news])
        assert sorted(i for part in news for i in ids(part)) == ids(decoded)
        assert (decoded.robot and decoded.robot.panels_used) == said[-1][-1][2]
    alone, both = [([7], False, (7,))], [([7, 23], False, (7, 23))]
    assert said == [[([7], True, (7,))], *[alone] * 5, [*alone, ([23], True, (7, 23))], both]


def test_what_was_handed_out_is_taken_back_where_a_newcomer_denies_it() -> None:
    """An ID in two places at once is in neither; from the next frame on it is not handed out at all."""
    path = pipeline(stream=True)
    one, other = (NEAR, word(7)), (square(500, 150, 90), word(7))
    said = []
    for n in range(8):
        news: list[Decoded] = []
        decoded = path.decode(frame_of(one, *[other] * (n >= 4), seq=n), on_partial=news.append)
        said.append(([i for part in news for i in ids(part)], ids(decoded)))
    assert said == [([7], [7])] * 6 + [([7], []), ([], [])]


def test_a_panel_that_comes_back_is_found_at_once() -> None:
    """Something stood in front of it for five frames, while another panel was in view; and it has moved meanwhile."""
    path = pipeline(stream=True)
    other, back = square(520, 130, 90), square(250, 300, 95)
    for n in range(6):
        path.decode(frame_of((other, word(23)), (NEAR, word(7)), seq=n))
    assert ids_of(path, [frame_of((other, word(23)), seq=n) for n in range(6, 11)]) == [[23]] * 5
    assert ids(path.decode(frame_of((other, word(23)), (back, word(7)), seq=11))) == [7, 23]


def test_nothing_survives_a_jump_in_time() -> None:
    """The next take of a recording begins anew: its first frame is as if it were the first of all."""
    path = pipeline(stream=True)
    take = [frame_of((NEAR, word(7)), seq=n) for n in (*range(5), *range(40, 43))]
    used = [path.decode(frame).markers[0].detection.frames_used for frame in take]
    assert used == [1, 2, 3, 4, 5, 1, 2, 3]


@pytest.mark.slow
def test_two_panels_that_pass_each_other_keep_their_ids() -> None:
    """7 moves right above, 23 left below, 9 px a frame, each past the other."""
    path = pipeline(stream=True)
    for n in range(16):
        one, other = square(200 + 9 * n, 170, 80), square(340 - 9 * n, 275, 85)
        decoded = path.decode(frame_of((one, word(7)), (other, word(23)), seq=n))
        found = {m.detection.id: m.detection.corners_px.mean(axis=0) for m in decoded.markers}
        np.testing.assert_allclose(found[7], one.mean(axis=0), atol=0.5)
        np.testing.assert_allclose(found[23], other.mean(axis=0), atol=0.5)


# ---- Whole scenes, rendered


def sensor(*, exposure_us: float = TRUE_10_MS_US) -> SimulatedSensor:
    return SimulatedSensor(
        intrinsics=ov5647_lens(), exposure_us=exposure_us, row_time_us=ROW_TIME_US, frame_length_rows=FRAME_ROWS
    )


def scene_frames(camera: SimulatedCamera) -> Iterable[Frame]:
    into: Pixels = np.empty((480, 640), np.uint8)
    while (frame := camera.read(into)) is not None:
        yield frame


def scene_path(scene: Scene, *, stream: bool) -> Pipeline:
    info = dataclasses.replace(camera_info(), exposure_us=scene.sensor.exposure_us)
    return Pipeline(info, panel_settings(), intrinsics=scene.sensor.intrinsics, stream=stream)


def test_a_drive_past_two_panels_is_read_without_a_wrong_id() -> None:
    """The robot swings past 7 and 23 on its way towards them: nine of ten detections, and each where it is."""
    scene = drive_scene(sensor(), {7: SPEC, 23: SPEC}, "DICT_4X4_50")
    camera = SimulatedCamera(scene, seed=4, paced=False, frames=60)
    path = scene_path(scene, stream=True)
    expected = seen = 0
    for frame in scene_frames(camera):
        truth = {t.id: t for t in camera.truth(frame.seq) if not t.optional}
        expected += len(truth)
        for marker in path.decode(frame).markers:
            true = truth[marker.detection.id]
            np.testing.assert_allclose(marker.detection.corners_px, true.corners_px, atol=2.0)
            seen += 1
    assert expected > 90
    assert seen > 0.9 * expected


def test_a_moving_panels_pose_is_that_of_its_centre_rows_moment() -> None:
    """0.5 m/s sideways at 1 m: 5 px a frame, 3 px within the exposure, 1 px from the panel's first row to its last."""
    start = facing_camera(np.array([-0.05, 0.0, 1.0]), yaw_deg=20)
    bits = load_dictionary("DICT_4X4_50").codeword(7)
    motion = Gliding(start=start, velocity_m_s=np.array([0.5, 0.0, 0.0]), start_s=1.0)
    scene = Scene(sensor=sensor(), panels=(Panel(codeword=bits, spec=SPEC, motion=motion, marker_id=7),))
    camera = SimulatedCamera(scene, seed=1, paced=False, frames=10)
    path = scene_path(scene, stream=True)
    errors = []
    for frame in scene_frames(camera):
        for marker in path.decode(frame).markers:
            assert marker.detection.id == 7
            assert marker.solution is not None
            (true,) = camera.truth(frame.seq)
            off = marker.solution.camera_from_marker.position_m - true.camera_from_marker.position_m
            errors.append(float(np.linalg.norm(off)))
    assert len(errors) >= 8
    assert np.median(errors) < 0.005


@pytest.mark.parametrize("place", ["tag", "exit", "hole"])
def test_printed_things_are_never_reported(place: str) -> None:
    """A lit ArUco marker, a lit word, a dark square on a bright wall."""
    drawing = np.zeros((480, 640), np.uint8)
    if place == "tag":
        raw = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        drawing[150:330, 230:410] = np.pad(cv2.aruco.generateImageMarker(raw, 7, 150), 15, constant_values=255)
    elif place == "exit":
        cv2.putText(drawing, "EXIT", (150, 300), cv2.FONT_HERSHEY_SIMPLEX, 4, 255, 20)
    else:
        drawing[:] = 200
        drawing[190:290, 260:360] = 20
    canvas = Canvas()
    canvas.light = cv2.GaussianBlur(0.02 + 0.6 * drawing / 255.0, (0, 0), 0.8)
    for stream in (False, True):
        path = pipeline(stream=stream)
        for n in range(6):
            assert path.decode(canvas.frame(n, seq=n)).markers == ()


def test_what_touches_a_panel_that_was_read_does_not_hide_it() -> None:
    """Its outline melts into that; its cells are where they are, to a twentieth of one."""
    path = pipeline(stream=True)
    assert ids_of(path, [frame_of((NEAR, word(7)), seq=seq) for seq in range(2)]) == [[7]] * 2
    for seq in range(2, 8):
        (marker,) = path.decode(touched_frame(NEAR, seq)).markers
        assert marker.detection.id == 7
        np.testing.assert_allclose(marker.detection.corners_px, NEAR, atol=1.25)
