"""The light in a painted panel's cells, for tests of what is made of it."""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Floats, Frame, Intrinsics, Mask, Quad
from ledpi.decode.evidence.cells import CellSamples, sample_cells
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.decision import Reading, read_codeword
from ledpi.decode.locate import Locator
from ledpi.decode.model.prior import prior
from ledpi.decode.observation import Observation
from tests.builders.decode import SPEC, quad, reason


def samples_of(frame: Frame, corners: Floats, lens: Intrinsics | None = None) -> CellSamples:
    """As if a panel of 4 × 4 cells had these corners."""
    samples = sample_cells(frame, quad(corners), 4, lens)
    assert isinstance(samples, CellSamples), reason(samples)
    return samples


def observed(frame: Frame, corners: Floats) -> Observation:
    """A panel of 4 × 4 cells as if its lattice had been fitted there; its unknowns are usual ones where none is."""
    locator = Locator(4, (SPEC,), None, must_blink=False)
    fitted, unknown = (
        locator.localise(frame, corners),
        prior(4, (9.0, 9.0), frame.exposure_us, even=False, faint=True)[0],
    )
    lattice = corners
    if isinstance(fitted, Quad) and fitted.lattice_px is not None and fitted.unknown is not None:
        unknown = fitted.unknown
        near = np.abs(fitted.lattice_px - corners).max() < 0.1 * np.linalg.norm(corners[1] - corners[0]) / 4
        lattice = fitted.lattice_px if near else corners
    seen = locator.observe(frame, Quad(corners_px=lattice, lattice_px=lattice, unknown=unknown))
    assert isinstance(seen, Observation), reason(seen)
    return seen


def bands_of(frame: Frame, corners: Floats, book: Codebook) -> Floats:
    """(16, P) that the panel's cells show, which must be read."""
    reading = read_codeword(samples_of(frame, corners), frame, book)
    assert isinstance(reading, Reading), reason(reading)
    return reading.cell_bands


def erased_cells(evidence: Evidence) -> Mask:
    """(16,) the cells of which it holds nothing."""
    blocks = evidence.own_information
    return ~blocks.any(axis=(1, 2))
