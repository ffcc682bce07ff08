"""The panels' bands, cleared of what is no band (walls, lamps, slopes), painted back into the picture. Pure."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from ledpi.core.records import Floats, Frame, Pixels, Quad
from ledpi.decode.evidence.cells import CellSamples, sample_cells
from ledpi.tap.frames import lens_told
from ledpi.tools.snapshot.enlarged import TILE, bands_tile


def paint_bands(
    onto: Pixels, pixels: Pixels, decoded: dict[str, Any], hello: dict[str, Any], cells: int
) -> float | None:
    """Paints each panel's bands over `onto` (H, W), in place. Returns the faintest full scale, a share of the light.

    `pixels`, (H, W), is the picture, `cells` how many a panel has along a side. None where no panel's cells can be
    sampled.
    """
    shares = []
    frame = _frame(pixels, decoded, hello)
    for marker in decoded["markers"]:
        corners = np.array(marker["corners_px"], np.float64)
        quad = Quad(corners_px=corners)
        samples = sample_cells(frame, quad, cells, lens_told(hello["camera"]))
        if isinstance(samples, CellSamples):
            tile, share = bands_tile(samples)
            _paint(onto, tile[..., 0], corners)
            shares.append(share)
    return min(shares, default=None)


def _paint(onto: Pixels, tile: Pixels, corners: Floats) -> None:
    # Pixel centres have whole numbers, so a tile reaches half a pixel beyond its first and its last one.
    square = np.array([[0, 0], [TILE, 0], [TILE, TILE], [0, TILE]], np.float32) - np.float32(0.5)
    warp = cv2.getPerspectiveTransform(square, corners.astype(np.float32))
    size = (onto.shape[1], onto.shape[0])
    painted = cv2.warpPerspective(np.ascontiguousarray(tile), warp, size, flags=cv2.INTER_AREA)
    covered = cv2.warpPerspective(np.full_like(tile, 255), warp, size, flags=cv2.INTER_NEAREST)
    np.copyto(onto, painted, where=np.asarray(covered > 0))


def _frame(pixels: Pixels, decoded: dict[str, Any], hello: dict[str, Any]) -> Frame:
    camera = hello["camera"]
    return Frame(
        pixels=pixels,
        seq=decoded["seq"],
        row0_readout_ns=decoded["sensor_timestamp_ns"],
        exposure_us=decoded.get("exposure_us") or camera["exposure_us"],
        row_time_us=camera["row_time_us"],
        transfer=camera.get("transfer", "linear"),
    )
