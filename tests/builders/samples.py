"""The light in a painted panel's cells, for tests of what is made of it."""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Floats, Frame, Intrinsics, Mask, PanelSpec, Quad, Rejected
from ledpi.decode.evidence.cells import CellSamples, Observation, sample_cells
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.decision import Reading
from ledpi.decode.identify.one_frame import read_frame
from ledpi.decode.locate import Locator
from ledpi.decode.model.prior import prior
from tests.builders.decode import SPEC, quad, reason


def samples_of(frame: Frame, corners: Floats, lens: Intrinsics | None = None) -> CellSamples:
    """As if a panel of 4 × 4 cells had these corners."""
    samples = sample_cells(frame, quad(corners), 4, lens)
    assert isinstance(samples, CellSamples), reason(samples)
    return samples


WEIGHER = LightWeigher(4, None)


def observed(frame: Frame, corners: Floats, spec: PanelSpec = SPEC) -> Observation:
    """A panel of 4 × 4 cells as if its lattice had been fitted there; its unknowns are usual ones where none is."""
    locator = Locator(4, (spec,), None, must_blink=False)
    fitted, lattice = locator.localise(frame, corners), corners
    unknown = prior(4, (9.0, 9.0), frame.exposure_us, even=False, faint=True)[0]
    if isinstance(fitted, Quad) and fitted.lattice_px is not None and fitted.unknown is not None:
        cell_px = np.linalg.norm(corners[1] - corners[0]) / 4
        if np.abs(fitted.lattice_px - corners).max() < 0.1 * cell_px:
            lattice, unknown = fitted.lattice_px, fitted.unknown
    seen = locator.observe(frame, Quad(corners_px=lattice, lattice_px=lattice, unknown=unknown), sampled=True)
    assert isinstance(seen, Observation), reason(seen)
    return seen


def evidence_at(frame: Frame, corners: Floats, spec: PanelSpec = SPEC) -> Evidence:
    """Evidence of one frame of a panel there."""
    evidence = WEIGHER.alone(observed(frame, corners, spec), spec)
    assert evidence is not None
    return evidence


def read_at(frame: Frame, corners: Floats, book: Codebook) -> Reading | Rejected:
    """Reads one frame of a panel there."""
    return read_frame(observed(frame, corners, book.spec), book, WEIGHER)


def bands_of(frame: Frame, corners: Floats, book: Codebook) -> Floats:
    """(16, P) that the panel's cells show, which must be read."""
    reading = read_at(frame, corners, book)
    assert isinstance(reading, Reading), reason(reading)
    return reading.cell_bands


def erased_cells(evidence: Evidence) -> Mask:
    """(16,) the cells of which it holds nothing."""
    blocks = evidence.own_information
    return ~blocks.any(axis=(1, 2))
