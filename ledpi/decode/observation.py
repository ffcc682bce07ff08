"""A fitted panel as one frame shows it: all that is kept of the frame."""

from __future__ import annotations

from typing import NamedTuple

from ledpi.core.records import Floats, Frame
from ledpi.decode.evidence.cells import CellSamples
from ledpi.decode.model.light import Window


class Observation(NamedTuple):
    """One frame of a panel."""

    frame: Frame  # its times count; it has no picture any more
    window: Window  # the light on the panel and around
    lattice_px: Floats  # (4, 2) corners of the lattice of its cells
    unknown: Floats  # what its picture was fitted with, as `decode.model.prior` has it
    samples: CellSamples | None = None  # of its cells, where frequencies are searched for
