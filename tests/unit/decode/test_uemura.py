"""The source paper's method: bands that can be seen are read, whatever else is told why it is not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from ledpi.camera.recording.picture import read_picture
from ledpi.camera.recording.reader import load_recording
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import ConfigError
from ledpi.core.records import Decoded, Detection, Floats, Frame, Intrinsics, PanelSpec, PanelValues, Rejected
from ledpi.decode.uemura import (
    BLACK_BAND,
    NO_BAND,
    WHITE_BAND,
    Steps,
    UemuraReader,
    add_frame,
    band_widths_rows,
    cell_shares,
    find_squares,
)
from ledpi.pipeline.pipeline import Pipeline
from tests.builders.decode import (
    PINHOLE,
    SHORT_US,
    SPEC,
    Bits,
    Canvas,
    camera_info,
    drawn,
    panel_settings,
    square,
    word,
)

PLACE = square(310.3, 240.6, 150, 4)
# A dark band at the rim takes its rows off the square: black's are 11.9 rows high, and a corner ends one side of each.
CORNER_PX = 12.0


def reader(dictionary: str = "DICT_4X4_50", spec: PanelSpec = SPEC) -> UemuraReader:
    known = load_dictionary(dictionary)
    return UemuraReader(known, list(range(len(known.codewords))), spec)


def photograph(cells: Bits, corners: Floats = PLACE, *, seq: int = 0, **how: object) -> Frame:
    """A panel at 151.5 µs, in noise of each frame's own."""
    canvas = Canvas(exposure_us=SHORT_US)
    canvas.panel(corners, cells, **how)  # type: ignore[arg-type]
    return canvas.frame(seq, seq=seq)


def detections(steps: Steps) -> list[Detection]:
    return [s.result for s in steps.squares if isinstance(s.result, Detection)]


def reasons(steps: Steps) -> set[str]:
    return {s.result.key for s in steps.squares if isinstance(s.result, Rejected)}


# ---- From a frame to an ID


@pytest.mark.parametrize("quarter_turns", [1, 2, 3])
@pytest.mark.parametrize("marker_id", [7, 23])
def test_the_first_corner_is_the_markers_top_left_one(marker_id: int, quarter_turns: int) -> None:
    """Turned clockwise by so much, which is what OpenCV's order of corners tells."""
    (detection,) = detections(reader().read(photograph(word(marker_id, quarter_turns))))
    assert detection.id == marker_id
    np.testing.assert_allclose(detection.corners_px, np.roll(PLACE, -quarter_turns, axis=0), atol=CORNER_PX)


def test_several_panels_are_read() -> None:
    """Each with the corners of its own; one turned away about its upright axis; in linear light, too."""
    oblique = np.array([[430.3, 40.6], [531.7, 62.2], [532.1, 222.4], [429.8, 241.9]])
    places = {0: square(130, 130, 130), 7: square(320, 350, 150, 8), 12: oblique}
    canvas = Canvas(exposure_us=SHORT_US, transfer="linear")
    for marker_id, corners in places.items():
        canvas.panel(corners, word(marker_id))
    found = {s.id: s.corners_px for s in detections(reader().read(canvas.frame()))}
    assert found.keys() == places.keys()
    for marker_id, corners in places.items():
        np.testing.assert_allclose(found[marker_id], corners, atol=CORNER_PX)


def test_other_grids_are_read() -> None:
    """Reads 6 × 6 cells; the word is OpenCV's own picture of the marker."""
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_6X6_50)
    cells = cv2.aruco.generateImageMarker(known, 31, 8)[1:-1, 1:-1] > 127
    corners = square(310.3, 240.6, 260, 3)

    def even(u: Floats, v: Floats) -> Floats:
        return np.ones_like(u)

    (detection,) = detections(reader("DICT_6X6_50").read(photograph(cells, corners, profile=even)))
    assert detection.id == 31
    np.testing.assert_allclose(detection.corners_px, corners, atol=CORNER_PX)


# ---- What is not read


def test_an_empty_picture_has_no_square() -> None:
    """And says so."""
    frame = Canvas(exposure_us=SHORT_US).frame()
    assert reader().read(frame).squares == ()
    decoded = path(exposure_us=SHORT_US).decode(frame)
    assert [why.key for why in decoded.rejected] == ["uemura.no_square"]


def test_what_is_not_square_is_none() -> None:
    """A round lamp, and a panel of which the picture shows only a part."""
    canvas = Canvas(exposure_us=SHORT_US)
    canvas.disc(450, 140, 50)
    canvas.panel(square(40, 300, 150), word(7))
    assert reader().read(canvas.frame()).squares == ()


@pytest.mark.parametrize("seed", range(6))
def test_a_lamp_that_does_not_blink_is_never_an_id(seed: int) -> None:
    """Tries any place, size, turn and brightness: noise makes no bands, and the square says that it has none."""
    rng = np.random.default_rng(seed)
    canvas = Canvas(exposure_us=SHORT_US)
    x, y = rng.uniform((200, 160), (440, 320))
    canvas.lamp(square(x, y, rng.uniform(25, 200), rng.uniform(-45, 45)), rng.uniform(0.1, 1.3))
    steps = reader().read(canvas.frame(seed))
    assert detections(steps) == []
    assert reasons(steps) == {"uemura.cell_without_bands"}


NO_WORDS = {
    "one cell of ID 7 changed": "1100/0100/1011/0010",
    "ID 7 in a mirror": "0011/0010/1111/0100",
    "all white": "1111/1111/1111/1111",
    "all black": "0000/0000/0000/0000",
}


@pytest.mark.parametrize("pattern", NO_WORDS.values(), ids=NO_WORDS)
def test_a_panel_that_shows_no_word_is_reported(pattern: str) -> None:
    """The cells are read as they are, and OpenCV knows no such marker."""
    steps = reader().read(photograph(drawn(pattern)))
    assert detections(steps) == []
    assert "uemura.not_in_dictionary" in reasons(steps)


def test_bands_of_a_few_grey_levels_are_not_seen() -> None:
    """At the 10 ms of the paper the light within a cell changes more than the bands do; `soft` reads the same frame."""
    canvas = Canvas()
    canvas.panel(PLACE, word(7))
    frame = canvas.frame()
    steps = reader().read(frame)
    assert detections(steps) == []
    assert reasons(steps) <= {"uemura.not_in_dictionary", "uemura.cell_without_bands"}
    by_soft = Pipeline(camera_info(), panel_settings(), intrinsics=PINHOLE, stream=False).decode(frame)
    assert [m.detection.id for m in by_soft.markers] == [7]


def test_cells_lower_than_a_band_are_not_read() -> None:
    """8 rows, where black's bands have 12: none is whole, and its width cannot be told."""
    steps = reader().read(photograph(word(7), square(310.3, 240.6, 32)))
    assert detections(steps) == []


# ---- Step by step


def test_expected_widths_are_the_papers() -> None:
    """w = n/T · 1/(2f), T = n · 33.67 µs: 11.88 rows at 1250 Hz, 6.06 at 2450 Hz."""
    frame = Canvas(exposure_us=SHORT_US).frame()
    assert band_widths_rows(frame, SPEC) == pytest.approx((11.880, 6.061), abs=0.001)


@pytest.mark.parametrize("turn_deg", [0, 15, 40])
def test_e_a_white_square_has_its_four_corners(turn_deg: float) -> None:
    """To a pixel and a half: an outline is made of whole pixels. From the one nearest the top left, clockwise."""
    corners = square(300.2, 250.7, 120, turn_deg)
    canvas = Canvas()
    canvas.lamp(corners)
    ((_, found),) = find_squares(canvas.frame().pixels, (11.9, 6.1), 12.0)
    np.testing.assert_allclose(found, np.roll(corners, -int(np.argmin(corners.sum(axis=1))), axis=0), atol=1.5)


def test_f_the_frame_is_one_cell_wide() -> None:
    """Makes it 10 pixels beyond each side of 4 × 4 cells of 10 pixels; in perspective, as far as lines converge."""
    upright = np.array([[100.0, 100], [140, 100], [140, 140], [100, 140]])
    np.testing.assert_allclose(add_frame(upright, 4), [[90, 90], [150, 90], [150, 150], [90, 150]])
    lens = cv2.getPerspectiveTransform(
        np.array([[0, 0], [4, 0], [4, 4], [0, 4]], np.float32),
        np.array([[100, 100], [140, 110], [138, 150], [102, 165]], np.float32),
    )
    framed = cv2.perspectiveTransform(np.array([[[-1.0, -1], [5, -1], [5, 5], [-1, 5]]]), lens)[0]
    shown = np.array([[100.0, 100], [140, 110], [138, 150], [102, 165]])
    np.testing.assert_allclose(add_frame(shown, 4), framed, atol=1e-3)


def test_g_a_cell_is_what_most_of_its_middle_shows() -> None:
    """Shares of black and of white; what lies near the cell's rim is not asked."""
    classes = np.zeros((80, 80), np.int8)
    classes[:40, :40] = BLACK_BAND
    classes[:40, 40:], classes[18:22, 40:] = WHITE_BAND, BLACK_BAND
    classes[40:, :40], classes[40:60, :40] = WHITE_BAND, NO_BAND
    classes[40:, 40:][8:32, 8:32] = BLACK_BAND
    corners = np.array([[-0.5, -0.5], [79.5, -0.5], [79.5, 79.5], [-0.5, 79.5]])
    black, white = cell_shares(classes, corners, 2)
    np.testing.assert_allclose(black, np.array([[1, 1 / 6], [0, 1]]), atol=0.02)
    np.testing.assert_allclose(white, np.array([[0, 5 / 6], [1 / 2, 0]]), atol=0.02)


# ---- In the pipeline


def path(*overrides: str, lens: Intrinsics | None = PINHOLE, exposure_us: float, stream: bool = False) -> Pipeline:
    info = camera_info(exposure_us=exposure_us)
    return Pipeline(info, panel_settings(*overrides), intrinsics=lens, method="uemura", stream=stream)


def ids(decoded: Decoded) -> list[int]:
    return sorted(m.detection.id for m in decoded.markers)


def test_antiphase_panels_are_refused() -> None:
    """Whoever says that they are so, a configuration or a recording: both classes have bands of one height."""
    blinking = {"black_hz": 1250.0, "white_hz": 1250.0, "duty": 0.5, "phase": "antiphase"}
    shown = PanelValues(dictionary="DICT_4X4_50", side_m=0.16, **blinking)  # type: ignore[arg-type]
    with pytest.raises(
        ConfigError, match=r"uemura distinguishes .* at 1250 Hz in antiphase they are alike; must be likelihood"
    ):
        Pipeline(camera_info(), panel_settings(), intrinsics=None, source_panel=shown, method="uemura")


def test_it_claims_no_margin() -> None:
    """Its answer is weighed against no other, nor needs many frames; its time has its own name, and a place is solved.

    150 px of 16 cm at a focal length of 640 px are 0.683 m away; corners are off by up to a band, so by tenths.
    """
    pipeline = path(exposure_us=SHORT_US, stream=True)
    for seq in range(3):
        decoded = pipeline.decode(photograph(word(7), seq=seq))
        (marker,) = decoded.markers
        assert (marker.detection.margin, marker.detection.frames_used) == (0.0, 1)
        assert list(decoded.stage_ms) == ["uemura", "pose"]
        assert marker.solution is not None
        assert marker.solution.camera_from_marker.position_m[2] == pytest.approx(0.683, rel=0.1)


def test_a_panel_of_other_frequencies_is_read_with_those() -> None:
    """Beside one of the common frequencies; the width of one panel's bands says nothing about the other's."""
    slow = PanelSpec(side_m=0.16, black_hz=900.0, white_hz=1500.0)
    canvas = Canvas(exposure_us=SHORT_US)
    canvas.panel(square(170, 240, 160), word(7))
    canvas.panel(square(450, 240, 200), word(23), spec=slow)
    pipeline = path("panels.overrides.23={black_hz: 900, white_hz: 1500}", exposure_us=SHORT_US)
    assert ids(pipeline.decode(canvas.frame())) == [7, 23]


def test_recordings_by_other_code_are_read_where_their_bands_are_deep(shared: Callable[[str], Path]) -> None:
    """At 150 µs, most frames and no wrong ID."""
    recording = load_recording(shared("recordings/short_exposure/d0.8"))
    camera = recording.camera
    shown = PanelValues(
        dictionary=recording.dictionary,
        **{key: getattr(recording.panel, key) for key in ("side_m", "black_hz", "white_hz", "duty")},
    )
    info = camera_info(exposure_us=camera.exposure_us)
    settings = panel_settings()
    pipeline = Pipeline(info, settings, intrinsics=camera.intrinsics, source_panel=shown, method="uemura", stream=False)
    assert recording.truth is not None
    read = 0
    for entry in recording.frames:
        pixels = np.empty((camera.height, camera.width), np.uint8)
        assert read_picture(entry.picture, pixels) is None
        found = ids(pipeline.decode(recording.frame(entry, pixels)))
        assert set(found) <= {marker.id for marker in recording.truth[entry.seq]}
        read += len(found)
    assert read > len(recording.frames) / 2
