"""The light in a painted panel's cells, for tests of what is made of it."""

from __future__ import annotations

from ledpi.core.records import Floats, Frame, Intrinsics, Mask
from ledpi.decode.cells import CellSamples, sample_cells
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.decision import Reading, read_codeword
from tests.builders.decode import quad, reason


def samples_of(frame: Frame, corners: Floats, lens: Intrinsics | None = None) -> CellSamples:
    """As if a panel of 4 × 4 cells had these corners."""
    samples = sample_cells(frame, quad(corners), 4, lens)
    assert isinstance(samples, CellSamples), reason(samples)
    return samples


def bands_of(frame: Frame, corners: Floats, book: Codebook) -> Floats:
    """(16, P) that the panel's cells show, which must be read."""
    reading = read_codeword(samples_of(frame, corners), frame, book)
    assert isinstance(reading, Reading), reason(reading)
    return reading.cell_bands


def erased_cells(evidence: Evidence) -> Mask:
    """(16,) the cells of which it holds nothing."""
    blocks = evidence.own_information
    return ~blocks.any(axis=(1, 2))
