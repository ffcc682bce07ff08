"""The fit of a panel's picture (panel_fit.c), and lattices of blobs (blobs.c, lattices.c)."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import DOUBLE, INTEGER, POINTER, address, function
from ledpi.records import Floats, Pixels

MOST_LINES, MOST_CELLS = 160, 8  # of a grid; along a side
DIVERGED, FITTED, WITHOUT_BANDS = 0, 1, 2  # outcomes of a fit
LATTICE_SPAN = 17  # nodes along a lattice that is found, its seed in the middle
MOST_RUNS, MOST_BLOBS, MOST_LATTICES = 40_000, 1_500, 12  # of a picture: what has more is texture

_work = function("ledpi_panel_work", result=ctypes.c_size_t)
_fit = function("ledpi_fit_panel", POINTER, POINTER, result=ctypes.c_int)
_blobs = function(
    "ledpi_blobs", *(POINTER,) * 2, *(INTEGER,) * 2, ctypes.c_int, DOUBLE, INTEGER, *(POINTER,) * 2, INTEGER, POINTER,
    result=INTEGER,
)  # fmt: skip
_lattices = function("ledpi_lattices", POINTER, INTEGER, INTEGER, POINTER, INTEGER, POINTER, result=INTEGER)


class PanelFit(ctypes.Structure):
    """`PanelFit` of panel_fit.h."""

    _fields_ = [
        ("light", ctypes.c_void_p),
        *((name, ctypes.c_ssize_t) for name in ("rows", "columns")),
        *((name, ctypes.c_double) for name in ("first_x", "first_y", "shrink", "saturated")),
        ("lens", ctypes.c_void_p),
        ("cells", ctypes.c_ssize_t),
        ("waves", ctypes.c_void_p),
        ("cycles_a_row", ctypes.c_double * 2),
        *((name, ctypes.c_double) for name in ("scale", "dark")),
        ("lines", ctypes.c_ssize_t),
        *((name, ctypes.c_void_p) for name in ("along", "prior")),
        *((name, ctypes.c_ssize_t) for name in ("rounds", "reweightings", "phasing")),
        ("tolerance", ctypes.c_double),
        ("must_blink", ctypes.c_ssize_t),
        ("corners", ctypes.c_double * 8),
        ("unknown", ctypes.c_void_p),
        ("lit", ctypes.c_double * 8),
        ("covariance", ctypes.c_double * 64),
        *((name, ctypes.c_double) for name in ("explained", "variance")),
    ]


class Solver:
    """Fits panels, one after the other, in room that it keeps."""

    def __init__(self) -> None:
        self._work: NDArray[np.uint8] = np.empty(_work(), np.uint8)

    def fit(self, fit: PanelFit) -> int:
        """DIVERGED, FITTED or WITHOUT_BANDS: what came of the fit, which is changed."""
        outcome: int = _fit(ctypes.addressof(fit), address(self._work))
        return outcome


class LatticeSearcher:
    """Finds lattices of bright blobs, in room that it keeps."""

    def __init__(self) -> None:
        self._runs, self._sums = np.empty((MOST_RUNS, 4), np.int32), np.empty((MOST_RUNS, 6))
        self._blobs, self._used = np.empty((MOST_BLOBS, 6)), np.empty(MOST_BLOBS, np.uint8)
        self._lattices = np.empty((MOST_LATTICES, LATTICE_SPAN, LATTICE_SPAN), np.int32)

    def search(
        self, pixels: Pixels, around: Pixels, contrast: int, most_area: float, least: int
    ) -> tuple[Floats, NDArray[np.int32]]:
        """Blobs (B, 6), x and y second and third; and lattices of at least `least` of them, (L, SPAN, SPAN) numbers.

        A blob's pixels (H, W) are brighter than `around` (H, W) by more than `contrast`. Both are the searcher's own.
        """
        count = _blobs(
            address(pixels), address(around), *pixels.shape, contrast, most_area,
            MOST_RUNS, address(self._runs), address(self._sums), MOST_BLOBS, address(self._blobs),
        )  # fmt: skip
        found = _lattices(
            address(self._blobs), count, least, address(self._used), MOST_LATTICES, address(self._lattices)
        )
        return self._blobs[:count], self._lattices[:found]
