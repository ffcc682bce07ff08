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


class Weigher:
    """Weighs what fitted panels' light says of their bands, in room that it keeps (panel_evidence.c)."""

    def __init__(self) -> None:
        self._room: NDArray[np.uint8] = np.empty(lib.ledpi_panel_evidence_room(), np.uint8)
        self._asked: Any = ffi.new("PanelEvidence *")

    def weigh(self, fit: dict[str, Any], **given: Any) -> tuple[bool, Any]:
        """True where there is evidence; and a `PanelEvidence` (core.h): its fields `given`, those of its fit `fit`."""
        for struct, values in ((self._asked.fit, fit), (self._asked, given)):
            for name, value in values.items():
                setattr(struct, name, pointer(value) if isinstance(value, np.ndarray) else value)
        return lib.ledpi_panel_evidence(self._asked, pointer(self._room)), self._asked
