"""Panels whose light is cut from real photographs of a blinking LED lamp: how many single frames are read.

Each row of a photograph (161.6 µs of exposure, rows of 33.67 µs) shows the lamp at its own moment, and so does each row
of a panel. So a panel's row gets the light of one row of a lamp in black's frequency and of one in white's, in cells
that are darker towards their dark walls; then it is blurred and gets noise. IDs, turns, places and photographs are
drawn with a seed. No photograph is high enough for a panel nearer than 1.5 m.

    python -m evaluation.accuracy.led_panels [../shared/real/led_bands] [--takes 60]
"""

from __future__ import annotations

import argparse
import itertools
import math
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from evaluation import ROOT
from evaluation.accuracy import led_bands
from evaluation.suites.readers import read_with_oracle
from ledpi.config.settings import load_config
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import CameraInfo
from ledpi.core.shutter import linear_light
from ledpi.pipeline.pipeline import Pipeline

Floats = NDArray[np.float64]

SIDES_PX = {2.0: 51.0, 1.5: 68.0}  # of a 16 cm panel at that many metres, 640 px focal length
SUB = 4  # points along a pixel
WALL = 0.03  # of a cell, on either side of a border
PEAK, BACKGROUND = 0.6, 0.03
BLUR_PX = 0.7
NOISE = 0.01


def light_of(lamp: led_bands.Photograph) -> Floats:
    """Returns each row's, of mean 1 over the lamp; what is saturated is as bright as the brightest that is not."""
    rows = led_bands.row_profile(lamp, led_bands.srgb_tone)
    rows = np.where(np.isfinite(rows), rows, np.nanmax(rows))
    return np.asarray(rows / rows.mean())


def panel_picture(
    codeword: NDArray[np.bool_], side: float, turn: float, lamps: list[Floats], seed: int
) -> tuple[Floats, Floats]:
    """(480, 640) linear light, and the panel's corners (4, 2) in it.

    `lamps`: of each row of black's and white's lamp, the panel's first row first.
    """
    rng = np.random.default_rng(seed)
    half = math.ceil(side / math.sqrt(2)) + 4
    size = 2 * half * SUB
    offset = (np.arange(size) + 0.5) / SUB - half
    x, y = np.meshgrid(offset, offset)
    c, s = math.cos(turn), math.sin(turn)
    u, v = 0.5 + (c * x + s * y) / side, 0.5 + (c * y - s * x) / side
    inside = (u >= 0) & (u < 1) & (v >= 0) & (v < 1)
    cells = len(codeword)
    column, row = (np.clip((cells * w).astype(int), 0, cells - 1) for w in (u, v))
    across, down = cells * u, cells * v
    wall = np.minimum(*(np.abs(w - np.clip(np.round(w), 1, cells - 1)) for w in (across, down))) < WALL
    diffuser = 1 - 0.6 * (np.square(across - column - 0.5) + np.square(down - row - 0.5))
    first = np.clip(np.arange(2 * half) - 4, 0, min(map(len, lamps)) - 1).repeat(SUB)
    lit = np.where(codeword[row, column], lamps[1][first][:, None], lamps[0][first][:, None])
    fine = np.where(inside & ~wall, diffuser * lit, 0.0)
    light = cv2.GaussianBlur(fine, (0, 0), BLUR_PX * SUB).reshape(2 * half, SUB, 2 * half, SUB).mean(axis=(1, 3))
    picture = np.full((480, 640), BACKGROUND)
    x0, y0 = (int(rng.integers(2, limit - 2 * half - 2)) for limit in (640, 480))
    picture[y0 : y0 + 2 * half, x0 : x0 + 2 * half] += PEAK * light / light.max()
    corners = side * np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) @ np.array([[c, s], [-s, c]])
    corners += (x0 + half - 0.5, y0 + half - 0.5)
    return np.asarray(picture + NOISE * np.sqrt(picture) * rng.standard_normal(picture.shape)), corners


def encoded(light: Floats) -> NDArray[np.uint8]:
    """sRGB codes of linear light: the nearest."""
    table = linear_light("srgb", mark_saturated=False).astype(np.float64)
    return np.searchsorted((table[1:] + table[:-1]) / 2, np.clip(light, 0, 1)).astype(np.uint8)


def recognised(lamps: list[led_bands.Photograph], side: float, takes: int, seed: int) -> tuple[int, int, int, int]:
    """Frames, of which right, wrong, and right with true corners.

    Panels are turned by any angle; lamps are those that are high enough for that.
    """
    rng = np.random.default_rng(seed)
    high = math.ceil(side * math.sqrt(2)) + 8
    pairs = [
        (a, b)
        for a, b in itertools.permutations([lamp for lamp in lamps if len(lamp.values) >= high], 2)
        if 1000 <= a.frequency_hz < b.frequency_hz != 2 * a.frequency_hz
    ]
    done = right = wrong = bound = 0
    for take in range(takes if pairs else 0):
        black, white = pairs[int(rng.integers(len(pairs)))]
        settings = (f"panels.black_hz={black.frequency_hz:g}", f"panels.white_hz={white.frequency_hz:g}")
        panels = load_config(None, ("panels.side_m=0.16", *settings)).panels
        dictionary = load_dictionary(panels.dictionary)
        marker_id = int(rng.integers(len(dictionary.codewords)))
        turn = float(rng.uniform(-math.pi, math.pi))
        light, corners = panel_picture(
            dictionary.codeword(marker_id), side, turn, [light_of(black), light_of(white)], 1000 * seed + take
        )
        frame = led_bands.frame_of(encoded(light))
        camera = CameraInfo(
            width=640, height=480, exposure_us=led_bands.EXPOSURE_US, row_time_us=led_bands.ROW_TIME_US, transfer="srgb"
        )
        ids = [m.detection.id for m in Pipeline(camera, panels, intrinsics=None, stream=False).decode(frame).markers]
        done, right, wrong = done + 1, right + (ids == [marker_id]), wrong + any(i != marker_id for i in ids)
        bound += read_with_oracle([(frame, corners)], None, panels.dictionary, panels.spec()) == [marker_id]
    return done, right, wrong, bound


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = ROOT.parent / "shared/real/led_bands"
    parser.add_argument("folder", nargs="?", type=Path, default=default)
    parser.add_argument("--takes", type=int, default=60)
    args = parser.parse_args()
    lamps, _ = led_bands.photographs(args.folder)
    for distance_m, side in SIDES_PX.items():
        done, right, wrong, bound = recognised(lamps, side, args.takes, seed=1)
        print(
            f"{distance_m:g} m ({side:g} px): {right} of {done} frames read, {wrong} with a wrong ID; "
            f"with true corners {bound}"
        )


if __name__ == "__main__":
    main()
