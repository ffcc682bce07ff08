"""What is lit in a picture: nearer to the brightest than to the darkest within a small window around (Bernsen).

Every bright thing so gets a dark moat, however bright the room is further away.
"""

from __future__ import annotations

import cv2
import numpy as np

from ledpi.kernels import lit as kernel
from ledpi.kernels.library import COMPILED
from ledpi.records import Pixels

WINDOW = 13  # pixels
MIN_CONTRAST = 16  # grey levels from the darkest in the window: less is noise and texture
_WINDOW, _MELT = np.ones((WINDOW, WINDOW), np.uint8), np.ones((3, 3), np.uint8)


class Lit:
    """Tells it of pictures of one size, in room that it keeps: first `look`, then `by` each threshold."""

    def __init__(self, height: int, width: int, *, compiled: bool = COMPILED) -> None:
        self._above, self._contrast, self._lit = (np.empty((height, width), np.uint8) for _ in range(3))
        self._lighter = kernel.Lighter(self._above, self._contrast, self._lit) if compiled else None

    def look(self, picture: Pixels) -> None:
        """Takes in a picture, rows without gaps between."""
        if self._lighter is not None:
            self._lighter.look(picture)
            return
        darkest = cv2.erode(picture, _WINDOW)
        cv2.subtract(picture, darkest, dst=self._above)
        cv2.subtract(cv2.dilate(picture, _WINDOW), darkest, dst=self._contrast)

    def by(self, share: int, *, opened: bool) -> Pixels:
        """255 where light is more than `share` 256ths of the way from the darkest to the brightest, else 0.

        Closed, so that cells melt together; `opened` after that, which cuts thin bridges to the surroundings. It lasts
        until the next call.
        """
        if self._lighter is not None:
            self._lighter.by(share, MIN_CONTRAST, opened)
            return self._lit
        threshold = np.maximum(self._contrast.astype(np.uint16) * share >> 8, MIN_CONTRAST).astype(np.uint8)
        cv2.compare(self._above, threshold, cv2.CMP_GT, dst=self._lit)
        cv2.morphologyEx(self._lit, cv2.MORPH_CLOSE, _MELT, dst=self._lit)
        if opened:
            cv2.morphologyEx(self._lit, cv2.MORPH_OPEN, _MELT, dst=self._lit)
        return self._lit
