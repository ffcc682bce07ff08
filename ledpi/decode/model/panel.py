"""The fit of a panel's picture (panel_fit.c)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ledpi.core.library import ffi, lib, pointer
from ledpi.core.records import Floats

MOST_LINES: int = lib.LEDPI_MOST_LINES  # of a grid
MOST_BANDS = 4  # cosine and sine of two waves


class Picture:
    """A panel's own picture to follow it by: a `PanelPicture` (core.h), whose fields are `arrays` and numbers."""

    __slots__ = ("arrays", "struct")

    def __init__(self, arrays: dict[str, NDArray[Any]], **numbers: Any) -> None:
        self.arrays, self.struct = arrays, ffi.new("PanelPicture *")
        _put(self.struct, {**arrays, **numbers})


def _put(struct: Any, values: dict[str, Any]) -> None:
    for name, value in values.items():
        setattr(struct, name, pointer(value) if isinstance(value, np.ndarray) else value)


class Followed(NamedTuple):
    """The place to which a panel has gone."""

    lattice: Floats  # (4, 2) corners, of its cells
    lit: Floats  # (4, 2) and of what is lit
    covariance: Floats  # (8, 8) of these
    hidden: list[float]  # cells of each side that something hides
    variance: float  # of a sample within
    explained: float  # share of the squares of its light
    settled: bool  # the last step hardly moved anything, and all of the picture is seen
    sampled: int  # places


class Solver:
    """Fits panels, one after the other, in room that it keeps."""

    def __init__(self) -> None:
        self._room: NDArray[np.uint8] = np.empty(lib.ledpi_panel_room(), np.uint8)
        self._fit: Any = ffi.new("PanelFit *")
        self._columns: NDArray[np.float32] = np.empty(0, np.float32)

    def fit(self, **given: Any) -> tuple[int, Any]:
        """The outcome, LEDPI_FITTED or another, and a `PanelFit` (core.h), whose fields are `given`; until the next.

        Arrays among them must outlive the call; `unknown` is changed.
        """
        _put(self._fit, given)
        return lib.ledpi_fit_panel(self._fit, pointer(self._room)), self._fit

    def put_picture(self, picture: Picture, shares: NDArray[np.float64], **given: Any) -> None:
        """Draws into `picture` what a fit that came to `given` has; `shares` (cells, waves) of waves in its cells."""
        _put(self._fit, given)
        lib.ledpi_panel_picture(self._fit, pointer(shares), picture.struct, pointer(self._room))

    def follow(self, picture: Picture, **given: Any) -> Followed | None:
        """Follows a panel from its corners in `given`; None where it is not found."""
        fit, struct = self._fit, picture.struct
        _put(fit, {**given, "sampled": 0})
        size = (2 + MOST_BANDS) * struct.lines * struct.width
        if len(self._columns) < size:
            self._columns = np.empty(size, np.float32)
        if not lib.ledpi_follow_panel(fit, struct, pointer(self._columns)):
            return None
        return Followed(
            lattice=np.array(list(fit.corners)).reshape(4, 2),
            lit=np.array(list(fit.lit)).reshape(4, 2),
            covariance=np.array(list(fit.covariance)).reshape(8, 8),
            hidden=list(fit.hidden),
            variance=fit.variance,
            explained=fit.explained,
            settled=fit.settled,
            sampled=fit.sampled,
        )


class Weigher:
    """Weighs what fitted panels' light says of their bands, in room that it keeps (panel_evidence.c)."""

    def __init__(self) -> None:
        self._room: NDArray[np.uint8] = np.empty(lib.ledpi_panel_evidence_room(), np.uint8)
        self._asked: Any = ffi.new("PanelEvidence *")

    def weigh(self, fit: dict[str, Any], **given: Any) -> tuple[bool, Any]:
        """True where there is evidence; and a `PanelEvidence` (core.h): its fields `given`, those of its fit `fit`."""
        _put(self._asked.fit, fit)
        _put(self._asked, given)
        return lib.ledpi_panel_evidence(self._asked, pointer(self._room)), self._asked
