"""The fit of a panel's picture (panel_fit.c)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import ffi, lib, pointer

MOST_LINES: int = lib.LEDPI_MOST_LINES  # of a grid


class Solver:
    """Fits panels, one after the other, in room that it keeps."""

    def __init__(self) -> None:
        self._room: NDArray[np.uint8] = np.empty(lib.ledpi_panel_room(), np.uint8)
        self._fit: Any = ffi.new("PanelFit *")

    def fit(self, **given: Any) -> tuple[int, Any]:
        """The outcome, LEDPI_FITTED or another, and a `PanelFit` (core.h), whose fields are `given`; until the next.

        Arrays among them must outlive the call; `unknown` is changed.
        """
        for name, value in given.items():
            setattr(self._fit, name, pointer(value) if isinstance(value, np.ndarray) else value)
        return lib.ledpi_fit_panel(self._fit, pointer(self._room)), self._fit
