"""Printed markers in the panels' place, and what reads them: OpenCV's ArUco detector, and AprilTag's own."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from typing import Literal

import cv2
import numpy as np

from ledpi.markers.codewords import Bits
from ledpi.markers.dictionaries import load_dictionary, opencv_dictionary
from ledpi.simulate.scene import Print, Scene

Family = Literal["aruco", "apriltag"]

# The most widely used family. Eight modules across, to ArUco's six: finer, but for that with far fewer false IDs.
APRILTAG = "tag36h11"
_OPENCV_APRILTAG = "DICT_APRILTAG_36h11"
# Ink returns about a fifteenth of what paper does.
INK = 0.06
# Of full scale, in the suite wild: a panel's hot spots may saturate, paper that does has lost its edges.
WHITEST_PAPER = 0.8


def has_apriltag() -> bool:
    """Tells whether AprilTag's detector is installed (an optional extra)."""
    return importlib.util.find_spec("pupil_apriltags") is not None


def printed_scene(scene: Scene, family: Family, dictionary: str, paper_level: float) -> Scene:
    """The scene with prints in place of its panels.

    The outer edge of a print's black border is where the edge of the panel's lit grid is, its paper as bright as the
    panel's bright bands: at short exposures that is far brighter than a room would light it.
    """
    prints = []
    for panel in scene.panels:
        assert panel.marker_id is not None
        modules = printed_modules(family, dictionary, panel.marker_id)
        prints.append(
            Print(
                modules=modules,
                width_m=panel.spec.side_m,
                motion=panel.motion,
                white=paper_level,
                black=INK * paper_level,
            )
        )
    return replace(scene, panels=(), prints=(*scene.prints, *prints))


def printed_id(family: Family, dictionary: str, marker_id: int) -> int:
    """The ID that stands in for a panel's, where the printed family has fewer."""
    return marker_id % len(_known(family, dictionary).bytesList)


def printed_modules(family: Family, dictionary: str, marker_id: int) -> Bits:
    """(n, n) modules of a marker with its black border, True where white."""
    known = _known(family, dictionary)
    side = known.markerSize + 2
    picture = cv2.aruco.generateImageMarker(known, printed_id(family, dictionary, marker_id), side, borderBits=1)
    return np.asarray(picture > 127)


def _known(family: Family, dictionary: str) -> cv2.aruco.Dictionary:
    if family == "aruco":
        return opencv_dictionary(load_dictionary(dictionary))
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, _OPENCV_APRILTAG))
