"""Panels as the page shows them: drawn over a picture, and in the map from above.

Over a picture, pixel centres have whole numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from ledpi.core.codewords import Dictionary
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.geometry import matrix_from_quaternion, project_to_quad
from ledpi.core.lens import projected
from ledpi.core.records import Floats, Frame, Pixels, Quad
from ledpi.daemon.tap.frames import lens_told, not_read_of
from ledpi.decode.evidence.cells import CellSamples, sample_cells
from ledpi.pipeline.diagnosis.diagnose import Diagnosis
from ledpi.pipeline.diagnosis.reasons import explained
from ledpi.workshop.monitor import heading_deg, place_of
from ledpi.workshop.snapshot.page import TILE, bands_tile

CELL_SHARE = 0.9  # of a cell's pitch that is coloured


def drawn(decoded: dict[str, Any], hello: dict[str, Any]) -> list[dict[str, Any]]:
    """Each panel of a line `decoded`: ID and corners, axes (None without a pose), cells with their class."""
    dictionary = dictionary_of(hello)
    return [
        {
            "id": marker["id"],
            "corners_px": marker["corners_px"],
            "axes_px": _axes(marker, hello),
            "cells": _word_cells(marker, dictionary),
            **place_of(marker),
        }
        for marker in decoded["markers"]
    ]


def drawn_reasons(diagnoses: Sequence[Diagnosis]) -> list[dict[str, Any]]:
    """Tells what was no panel that is read: its corners, what is wrong, what helps, and its cells as they seem."""
    return [
        {
            "corners_px": one.corners_px.tolist(),
            "kind": one.kind,
            "why": one.why,
            "says": one.says,
            "helps": one.helps,
            "cells": [] if one.cells_nats is None else _cells(one.corners_px, one.cells_nats > 0),
        }
        for one in diagnoses
    ]


def plain_reasons(picture: dict[str, Any]) -> list[Diagnosis]:
    """The path's own reasons, where the daemon's panels cannot be looked for here."""
    return [
        Diagnosis(corners_px=one.corners_px, why=one.why, says=says, helps=helps, kind="light")
        for one in not_read_of(picture)
        for says, helps in [explained(one.why)]
    ]


def dictionary_of(hello: dict[str, Any]) -> Dictionary | None:
    """None where it is a file of its own that cannot be read here."""
    try:
        return load_dictionary(hello["panels"]["dictionary"])
    except (ValueError, KeyError, TypeError):
        return None


def _word_cells(marker: dict[str, Any], dictionary: Dictionary | None) -> list[dict[str, Any]]:
    if dictionary is None or marker["id"] >= len(dictionary.codewords):
        return []
    return _cells(np.array(marker["corners_px"], np.float64), dictionary.codeword(marker["id"]))


def _cells(corners: Floats, white: np.ndarray) -> list[dict[str, Any]]:
    """Every cell's quad between a panel's corners (4, 2), and whether it is of white's class."""
    n = len(white)
    inset = (1 - CELL_SHARE) / 2
    quads = []
    for (row, column), bit in np.ndenumerate(white):
        left, right = (column + inset) / n, (column + 1 - inset) / n
        top, bottom = (row + inset) / n, (row + 1 - inset) / n
        at = project_to_quad(corners, np.array([[left, top], [right, top], [right, bottom], [left, bottom]]))
        quads.append({"corners_px": np.round(at, 1).tolist(), "white": bool(bit)})
    return quads


def _axes(marker: dict[str, Any], hello: dict[str, Any]) -> list[list[float]] | None:
    """Centre, and tips of x, y and z, half a side long; None without pose or lens."""
    lens = lens_told(hello["camera"])
    if marker["position_m"] is None or lens is None:
        return None
    ends_m = np.concatenate([np.zeros((1, 3)), hello["panels"]["side_m"] / 2 * np.eye(3)])
    turn = matrix_from_quaternion(np.array(marker["quaternion_wxyz"]))
    seen, _ = projected(ends_m @ turn.T + np.array(marker["position_m"]), lens)
    tips: list[list[float]] = np.round(seen, 1).tolist()
    return tips if np.isfinite(seen).all() else None


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


RECKONS_S = 0.3  # without a panel, after which the state is told to reckon
SIGMAS = 2.0  # of the ellipse's half axes: it holds 86 %


def panels_from_above(hello: dict[str, Any]) -> list[dict[str, Any]]:
    """ID and corners (4, 2) of each panel of the daemon's map. A panel on a wall is a line from above."""
    panels = []
    for marker_id, panel in sorted((hello.get("map") or {}).items(), key=lambda item: int(item[0])):
        turn = matrix_from_quaternion(np.array(panel["quaternion_wxyz"], np.float64))
        half = (panel.get("side_m") or hello["panels"]["side_m"]) / 2
        corners = half * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]) @ turn.T
        corners += np.array(panel["position_m"])
        facing = turn[:2, 2].round(3).tolist()
        panels.append({"id": int(marker_id), "corners_m": corners[:, :2].round(3).tolist(), "facing": facing})
    return panels


def robot_from_above(robot: dict[str, Any] | None) -> dict[str, Any] | None:
    """Place, heading (rad, from x towards y) and error ellipse of a line's `robot`."""
    if robot is None:
        return None
    return {
        "position_m": robot["position_m"][:2],
        "heading_rad": round(math.radians(heading_deg(robot["quaternion_wxyz"])), 4),
        "ellipse": _ellipse(robot.get("covariance")),
        "by": _named("panel", robot.get("panels_used", [])),
    }


def robot_of_state(state: dict[str, Any]) -> dict[str, Any]:
    """The same of a `robot_state` line that has one, with what it rests on in words."""
    since_s, way_m = (state["t_ns"] - state["panel_ns"]) * 1e-9, state["way_m"]
    by = "odometry and panels" if state["mode"] == "odometry" else "panels, without odometry"
    if since_s > RECKONS_S:
        goes_on = "dead reckoning" if state["mode"] == "odometry" else "going on as it moved"
        by = f"{goes_on}, {since_s:.1f} s and {way_m:.2f} m since the last panel"
    if state["contested"]:
        by += "; another place is possible"
    if state["moved"]:
        by += f"; not where the map has it: {_named('panel', state['moved'])}"
    return {
        "position_m": state["position_m"],
        "heading_rad": state["yaw_rad"],
        "ellipse": _ellipse(state["covariance"]),
        "by": by,
    }


def _named(what: str, ids: list[int]) -> str:
    return f"{what if len(ids) == 1 else what + 's'} {', '.join(map(str, ids))}"


def _ellipse(covariance: list[float] | None) -> dict[str, float] | None:
    """Half axes (m) and angle (rad) of SIGMAS deviations, if known; `covariance`: row by row, x and y first."""
    if covariance is None:
        return None
    size = math.isqrt(len(covariance))
    spread, axes = np.linalg.eigh(np.array(covariance, np.float64).reshape(size, size)[:2, :2])
    short, long = SIGMAS * np.sqrt(np.maximum(spread, 0.0))
    return {
        "long_m": round(float(long), 5),
        "short_m": round(float(short), 5),
        "angle_rad": round(math.atan2(axes[1, 1], axes[0, 1]), 4),
    }
