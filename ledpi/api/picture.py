"""Pictures as programs have them: numpy arrays, one byte a pixel. What is not one is refused, with what would be."""

from __future__ import annotations

import threading
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ledpi.core.errors import PictureError
from ledpi.core.records import Pixels

# What programs have: cv2.imread gives None where it cannot read a file, and its stubs know no dtype.
Image: TypeAlias = "NDArray[Any] | None"
_GREY = "must be grey, (height, width) uint8"


def checked_picture(image: object) -> Pixels:
    """The picture as a view: nothing is copied, and the caller's own array stays writable.

    Raises PictureError for anything but (height, width) uint8. Colours are not mixed here: which channel comes
    first, nothing tells.
    """
    if not isinstance(image, np.ndarray):
        nothing = "; cv2.imread and others return None where they cannot read a file" if image is None else ""
        raise PictureError(f"image: {_GREY}, as a numpy array, not {type(image).__name__}{nothing}")
    if image.ndim == 3:
        raise PictureError(
            f"image: {_GREY}, not {_shape(image)} {image.dtype}: of colours take the grey, as by "
            "cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)"
        )
    if image.ndim != 2 or image.dtype != np.uint8:
        raise PictureError(f"image: {_GREY}, not {_shape(image)} {image.dtype}")
    return image.view(np.ndarray)


def check_size(picture: Pixels, width: int, height: int, because: str) -> None:
    """Raises PictureError where the picture is not so large. `because`: who says that it should be."""
    if picture.shape == (height, width):
        return
    has_chroma = picture.shape == (height * 3 // 2, width)
    below = f": below its grey rows are YUV420's colours; give image[:{height}]" if has_chroma else ""
    raise PictureError(
        f"image: must be {width} × {height} pixels, as {because}, not {picture.shape[1]} × {picture.shape[0]}{below}"
    )


class OneAtATime:
    """Guards what is not to be shared between threads: `with` it, two calls at once raise PictureError."""

    def __init__(self, what: str) -> None:
        self._what, self._lock = what, threading.Lock()

    def __enter__(self) -> None:
        if not self._lock.acquire(blocking=False):
            raise PictureError(f"this {self._what} is in use by another thread; make one for each thread")

    def __exit__(self, *_: object) -> None:
        self._lock.release()


def _shape(image: np.ndarray[tuple[int, ...], np.dtype[np.generic]]) -> str:
    return f"({', '.join(map(str, image.shape))})"
