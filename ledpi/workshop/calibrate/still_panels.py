"""Panels at rest in a series of frames: found by the decoder's own first stages, then summed up row by row."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ledpi.config.panels import PanelSettings
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import CalibrationError
from ledpi.core.geometry import unit_square_homography
from ledpi.core.lens import undistort
from ledpi.core.records import Floats, Frame, Intrinsics, PanelSpec
from ledpi.core.shutter import SATURATED, linear_light
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pipeline.trace import Trace
from ledpi.workshop.calibrate.bands import PanelLight
from ledpi.workshop.calibrate.taking import Taken

Result = TypeVar("Result")

RIM = 0.12  # of a cell, left out on each side: there the neighbour's light mixes in
SAME_PLACE = 0.3  # of the side: a square's centre this near to another's is the same square
MAX_MOTION_PX = 0.5  # of a corner, from the first half to the second: every pixel must go on showing the same spot
MIN_SHARE = 0.25  # of a cell's pixels that must not be saturated


def measure_still(
    taken: Taken, measure: Callable[[PanelLight, PanelSpec, Floats], Result], most: int | None = None
) -> list[tuple[Result, Floats]]:
    """Each square at rest, from the largest on, by the first pair of announced frequencies that it can be.

    `measure` takes its light, those frequencies and its corners, and raises CalibrationError where it is no such
    panel. Returns the results, `most` of them, with the corners. Raises CalibrationError, why the last square has
    none, where none has any.
    """
    pipeline = Pipeline(taken.camera, taken.panels, intrinsics=taken.intrinsics, stream=False)
    found: list[tuple[Result, Floats]] = []
    why = "no lit square is in view"
    for corners in still_squares(taken.frames, pipeline):
        if len(found) == most:
            break
        try:
            cells = load_dictionary(taken.panels.dictionary).cells_per_side
            light = panel_light(taken.frames, corners, cells, taken.intrinsics)
        except CalibrationError as error:
            why = str(error)
            continue
        for spec in _announced_specs(taken.panels):
            try:
                found.append((measure(light, spec, corners), corners))
                break
            except CalibrationError as error:
                why = str(error)
    if not found:
        raise CalibrationError(why)
    return found


def _announced_specs(panels: PanelSettings) -> list[PanelSpec]:
    """Every pair of frequencies that a panel is announced with, the common one first."""
    specs = [panels.spec(), *(panels.spec(marker_id) for marker_id in panels.overrides)]
    return list({(spec.black_hz, spec.white_hz): spec for spec in reversed(specs)}.values())[::-1]


def still_squares(frames: Sequence[Frame], pipeline: Pipeline) -> list[Floats]:
    """Corners (4, 2) of every lit square that stands still, the largest first.

    Sought in the mean of all frames, in which bands have averaged out: also deep ones, that cut an edge off a frame.
    Raises CalibrationError where there is none.
    """
    half = len(frames) // 2
    before, after = (_squares(mean_frame(part), pipeline) for part in (frames[:half], frames[half:]))
    still = [
        corners
        for corners in _squares(mean_frame(frames), pipeline)
        if (earlier := _same_place(corners, before)) is not None
        and (later := _same_place(corners, after)) is not None
        and float(np.abs(later - earlier).max()) <= MAX_MOTION_PX
    ]
    if not still:
        raise CalibrationError("no lit square stands still in view: put camera and panel at rest, at a metre or so")
    return sorted(still, key=lambda corners: -_side_px(corners))


def mean_frame(frames: Sequence[Frame]) -> Frame:
    """The mean of many as one picture, at the first one's time; bands are no deeper than in one exposure as long."""
    total = np.zeros(frames[0].pixels.shape, np.uint32)
    for frame in frames:
        total += frame.pixels
    return replace(
        frames[0],
        pixels=np.asarray(np.rint(total / len(frames)), np.uint8),
        exposure_us=sum(frame.exposure_us for frame in frames),
    )


def panel_light(frames: Sequence[Frame], corners_px: Floats, cells: int, intrinsics: Intrinsics | None) -> PanelLight:
    """The light of `cells` × `cells` cells, summed over each picture row.

    Raises CalibrationError if it is too bright, or the same in all frames.
    """
    low = np.maximum(np.floor(corners_px.min(axis=0)).astype(int), 0)
    high = np.ceil(corners_px.max(axis=0)).astype(int) + 1
    area = (slice(low[1], high[1]), slice(low[0], high[0]))
    if all(np.array_equal(frame.pixels[area], frames[0].pixels[area]) for frame in frames):
        raise CalibrationError("all frames show the very same light: one picture over and over measures nothing")
    cell = _cell_of_pixel(frames[0].pixels[area].shape, low, corners_px, cells, intrinsics)
    inside = cell >= 0
    brightest = np.maximum.reduce([frame.pixels[area] for frame in frames])
    clear = inside & (brightest < SATURATED)
    pixels = np.bincount(cell[inside], minlength=cells * cells)
    if not pixels.all():
        raise CalibrationError("the panel's cells are smaller than pixels: put the camera nearer, and before the panel")
    left = np.bincount(cell[clear], minlength=cells * cells) / pixels
    if left.min() < MIN_SHARE:
        raise CalibrationError("the panel is too bright, its pixels are saturated: lower camera.analogue_gain")
    rows = cell.shape[0]
    index = (cell * rows + np.arange(rows)[:, None])[clear]
    table = linear_light(frames[0].transfer)
    light = [np.bincount(index, table[frame.pixels[area][clear]], minlength=cells * cells * rows) for frame in frames]
    seconds, interval_us = steady_seconds(frames)
    return PanelLight(
        light=np.array(light, np.float64).reshape(len(frames), cells * cells, rows),
        seconds=seconds,
        frame_interval_us=interval_us,
    )


def reads(frames: Sequence[Frame], pipeline: Pipeline, marker_id: int, corners_px: Floats) -> bool:
    """Tells whether the decoder reads `marker_id` at this place in any of the frames."""
    for frame in frames:
        for marker in pipeline.decode(frame).markers:
            away = marker.detection.corners_px.mean(axis=0) - corners_px.mean(axis=0)
            if marker.detection.id == marker_id and np.hypot(*away) < SAME_PLACE * _side_px(corners_px):
                return True
    return False


def steady_seconds(frames: Sequence[Frame]) -> tuple[Floats, float]:
    """(frames,) read-out times of row 0 from the first frame, on a line through all, and the interval in µs.

    A sensor's period is constant, but interrupts date a frame late by some µs, which at 2450 Hz is a part of a cycle.
    """
    seq = np.array([frame.seq - frames[0].seq for frame in frames], np.float64)
    seconds = np.array([frame.row0_readout_ns - frames[0].row0_readout_ns for frame in frames]) * 1e-9
    line = np.polynomial.Polynomial.fit(seq, seconds, 1)
    return np.asarray(line(seq), np.float64), float(line.deriv()(0.0)) * 1e6


def _squares(frame: Frame, pipeline: Pipeline) -> list[Floats]:
    trace = Trace()
    pipeline.decode(frame, trace)
    return [square.quad.corners_px for square in trace.squares]


def _same_place(corners: Floats, others: list[Floats]) -> Floats | None:
    """Returns, of the other squares, the one at the same place, its corners in the same order."""
    turned = [np.roll(other, k, axis=0) for other in others for k in range(4)]
    nearest = min(turned, key=lambda other: float(np.abs(other - corners).max()), default=None)
    if nearest is None or np.abs(nearest - corners).max() > SAME_PLACE * _side_px(corners):
        return None
    return nearest


def _side_px(corners: Floats) -> float:
    sides = np.roll(corners, -1, axis=0) - corners
    return float(math.sqrt(np.square(sides).sum() / 4))


def _cell_of_pixel(
    shape: tuple[int, ...], low: NDArray[np.int64], corners_px: Floats, cells: int, intrinsics: Intrinsics | None
) -> NDArray[np.int64]:
    """(h, w) number of the cell that a pixel of the panel's box lies in, away from its rim; −1 elsewhere."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    pixels = np.stack([x + low[0], y + low[1]], axis=-1).astype(np.float64)
    corners = corners_px
    if intrinsics is not None:
        pixels, corners = undistort(pixels, intrinsics), undistort(corners_px, intrinsics)
    to_unit = np.linalg.inv(unit_square_homography(corners))
    u, v, scale = np.moveaxis(np.concatenate([pixels, np.ones((*shape, 1))], axis=-1) @ to_unit.T, -1, 0)
    place = np.stack([u, v]) / scale * cells
    whole = np.floor(place)
    within = (whole >= 0) & (whole < cells) & (np.abs(place - whole - 0.5) < 0.5 - RIM)
    column, row = whole.astype(np.int64)
    return np.where(within.all(axis=0), row * cells + column, -1)
