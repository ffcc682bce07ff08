"""What is lit in a picture: brighter than a grey level, or than a share of the contrast in a window around (Bernsen).

By the latter every bright thing gets a dark moat, however bright the room is further away. The reference of
kernels/lit.c.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.records import Pixels

WINDOW = 13  # pixels
MIN_CONTRAST = 16  # grey levels from the darkest in the window: less is noise and texture
_WINDOW, _MELT = np.ones((WINDOW, WINDOW), np.uint8), np.ones((3, 3), np.uint8)


def contrasts(picture: Pixels) -> tuple[Pixels, Pixels]:
    """Of each pixel how far it is above the darkest around it, and how far the brightest around it is."""
    darkest = cv2.erode(picture, _WINDOW)
    return picture - darkest, cv2.dilate(picture, _WINDOW) - darkest


def threshold_of(share: int, contrast: Pixels) -> NDArray[np.uint16]:
    """How far above the darkest a pixel must be to be lit."""
    threshold: NDArray[np.uint16] = np.maximum(contrast.astype(np.uint16) * share >> 8, MIN_CONTRAST)
    return threshold


def closed(picture: Pixels) -> Pixels:
    """The picture with what is darker than what lies to either side of it as bright as that: so cells melt together."""
    melted: Pixels = cv2.morphologyEx(picture, cv2.MORPH_CLOSE, _MELT)
    return melted


def brighter(level: int, closed_picture: Pixels) -> Pixels:
    """255 where light is above a grey level, else 0."""
    lit: Pixels = 255 * (closed_picture > level).astype(np.uint8)
    return lit


def lit_by(share: int, above: Pixels, contrast: Pixels, *, opened: bool) -> Pixels:
    """255 where light is more than `share` 256ths of the way from the darkest to the brightest, else 0.

    Closed, so that cells melt together; `opened` after that, which cuts thin bridges to the surroundings.
    """
    lit: Pixels = 255 * (above > threshold_of(share, contrast)).astype(np.uint8)
    cv2.morphologyEx(lit, cv2.MORPH_CLOSE, _MELT, dst=lit)
    if opened:
        cv2.morphologyEx(lit, cv2.MORPH_OPEN, _MELT, dst=lit)
    return lit
