"""Exposures so short that dark bands cut panels: what is found of a panel is all of it, or nothing."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.pipeline.pipeline import Pipeline
from tests.builders.decode import (
    FRAME_ROWS,
    PINHOLE,
    ROW_TIME_US,
    SHORT_US,
    TRUE_10_MS_US,
    Canvas,
    Profile,
    camera_info,
    diffuser,
    drawn,
    flat,
    panel_settings,
    square,
    word,
)

PANEL = square(310.3, 240.6, 130)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("exposure_us", "profile"),
    [
        (SHORT_US, flat),
        (300.0, flat),
        *((exposure_us, diffuser) for exposure_us in (560.0, 640.0, 1000.0, 1200.0, 2000.0, TRUE_10_MS_US)),
    ],
)
def test_half_a_panel_that_shows_the_very_same_is_no_panel(exposure_us: float, profile: Profile) -> None:
    """Two rows of four cells, 0110 and 0000, from the front: not word 17, in no frame. By its shape, or its walls."""
    path = Pipeline(camera_info(exposure_us=exposure_us), panel_settings(), intrinsics=PINHOLE)
    lit = np.repeat([[1.0], [0.0]], [2, 2], axis=0) * np.ones(4)
    for seq in range(8):
        canvas = Canvas(exposure_us=exposure_us)
        start_us = seq * FRAME_ROWS * ROW_TIME_US
        cells = drawn("0110/0000/0000/0000")
        canvas.panel(square(310.3, 240.6, 60, 4), cells, gains=lit, start_us=start_us, light=0.35, profile=profile)
        assert path.decode(canvas.frame(seq, seq=seq)).markers == ()


def part_in_stream(exposure_us: float, shape: float, side: float) -> list[list[int]]:
    """IDs in eight frames of a panel, narrower than a square, of which two rows of three cells are lit: 000 and 010."""
    path, lit = Pipeline(camera_info(exposure_us=exposure_us), panel_settings(), intrinsics=PINHOLE), np.zeros((4, 4))
    lit[:2, :3] = 1.0
    corners, ids = square(0, 0, side, 4) * (shape, 1.0) + (310.3, 240.6), []
    for seq in range(8):
        canvas = Canvas(exposure_us=exposure_us)
        cells, start_us = drawn("0000/0100/0000/0000"), seq * FRAME_ROWS * ROW_TIME_US
        canvas.panel(corners, cells, gains=lit, start_us=start_us, light=0.35, profile=flat)
        ids.append([marker.detection.id for marker in path.decode(canvas.frame(seq, seq=seq)).markers])
    return ids


@pytest.mark.parametrize("exposure_us", [TRUE_10_MS_US, 3000.0, 2000.0])
@pytest.mark.parametrize(("shape", "side"), [(1.0, 45.0), (0.9, 60.0)])
def test_a_part_that_looks_like_a_word_is_not_read_in_a_stream(exposure_us: float, shape: float, side: float) -> None:
    """Taken for four by four cells it shows word 17, but that four of these show both classes."""
    assert part_in_stream(exposure_us, shape, side) == [[]] * 8


@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize("exposure_us", [SHORT_US, TRUE_10_MS_US])
def test_word_17_is_read_where_it_is_said_to_exist(turns: int, exposure_us: float) -> None:
    """Else it is refused, as a part of another panel could have shown it."""
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(PANEL, word(17, turns), light=0.3, phases=(0.3, 0.7))
    camera = camera_info(exposure_us=exposure_us)
    known, unknown = (
        Pipeline(camera, panel_settings(*ids), intrinsics=PINHOLE, stream=False).decode(canvas.frame())
        for ids in (("panels.ids=[17]",), ())
    )
    assert [marker.detection.id for marker in known.markers] == [17]
    assert unknown.markers == ()
    assert "id_not_in_panels_ids" in {rejected.reason for rejected in unknown.rejected}


@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize("side", [60, 100, 160])
def test_two_cells_of_a_panel_nearby_are_no_panel(side: float, turns: int) -> None:
    """One of each class, with a speck of dirt where word 37 has its only cell that is not as they are."""
    speck = np.ones((4, 4))
    speck[1, 1] = 0.0
    canvas, halves = Canvas(), drawn("0000/0000/1111/1111")
    canvas.panel(square(310.3, 240.6, side, 4), np.rot90(halves, turns), gains=np.rot90(speck, turns))
    path = Pipeline(camera_info(), panel_settings(), intrinsics=PINHOLE, stream=False)
    assert path.decode(canvas.frame(turns)).markers == ()
