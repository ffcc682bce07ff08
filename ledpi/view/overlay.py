"""What the page draws over a picture, in the picture's coordinates: pixel centres have whole numbers."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np

from ledpi.core.geometry import matrix_from_quaternion, project_to_quad
from ledpi.core.records import Floats
from ledpi.markers.codewords import Dictionary
from ledpi.markers.dictionaries import load_dictionary
from ledpi.pipeline.mistakes import mistake_of
from ledpi.pipeline.reasons import explained
from ledpi.tools.monitor.table import yaw_deg

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


def place_of(marker: dict[str, Any]) -> dict[str, float | None]:
    """How far a panel is, and by how much it is turned to the side, as `ledpi monitor` says it."""
    if marker["position_m"] is None:
        return {"distance_m": None, "yaw_deg": None}
    turned_deg = yaw_deg(marker["quaternion_wxyz"])
    return {"distance_m": round(math.hypot(*marker["position_m"]), 4), "yaw_deg": round(turned_deg, 1)}


def why_not(picture: dict[str, Any], hello: dict[str, Any]) -> list[dict[str, Any]]:
    """Each candidate of a line `picture` that was no panel: its corners, its reason's key and words, and what helps.

    What `soft` has looked at also has its cells, as they seem, and the mistake that would explain them ("" if none).
    """
    dictionary = dictionary_of(hello)
    looks = [look for look in picture.get("looks", []) if look.get("why")]
    found = []
    for rejected in picture.get("rejected", []):
        corners = np.array(rejected["corners_px"], np.float64)
        look = next((x for x in looks if np.abs(np.array(x["corners_px"]) - corners).max() < 1.0), None)
        means, helps = explained(rejected["why"])
        nats = _square(look) if look is not None else None
        found.append(
            {
                "corners_px": rejected["corners_px"],
                "why": rejected["why"],
                "means": means,
                "helps": helps,
                "mistake": "" if nats is None or dictionary is None else mistake_of(nats, dictionary),
                "cells": [] if nats is None else _cells(corners, nats > 0),
            }
        )
    return found


def _square(look: dict[str, Any]) -> Floats | None:
    """(n, n) of the numbers of a look's cells; None where there are none, or not of a square."""
    nats = np.array(look.get("cells_nats") or [], np.float64)
    side = math.isqrt(nats.size)
    return nats.reshape(side, side) if side and side * side == nats.size else None


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
    camera = hello["camera"]
    if marker["position_m"] is None or camera.get("fx") is None:
        return None
    turn = cv2.Rodrigues(matrix_from_quaternion(np.array(marker["quaternion_wxyz"])))[0]
    matrix = np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1.0]])
    ends_m = np.concatenate([np.zeros((1, 3)), hello["panels"]["side_m"] / 2 * np.eye(3)])
    lens = np.array(camera.get("distortion") or [0.0] * 5)
    seen = cv2.projectPoints(ends_m, turn, np.array(marker["position_m"]), matrix, lens)[0]
    tips: list[list[float]] = np.round(seen.reshape(4, 2), 1).tolist()
    return tips
