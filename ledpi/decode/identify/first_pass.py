"""The first pass over a panel's samples: the evidence in them, and the codewords that explain it best."""

from __future__ import annotations

from ledpi.core.records import Floats, Frame, PanelSpec, Rejected, Singles
from ledpi.decode.evidence.cells import CellSamples
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.single_frame import single_evidence
from ledpi.decode.identify.codewords import Fit, rank_codewords


def first_pass(
    samples: CellSamples,
    frame: Frame,
    spec: PanelSpec,
    white: Singles,
    prior: Floats | None = None,
) -> tuple[Evidence, Fit] | Rejected:
    """The evidence of one picture, and the likeliest of the codewords (W, cells), 1 where the class is white.

    `prior` (P,): variance of the bands, if not as the exposure leaves them (`band_prior`).
    """
    evidence = single_evidence(samples, frame, spec)
    if isinstance(evidence, Rejected):
        return evidence
    if prior is not None:
        evidence = evidence._replace(prior=prior)
    return evidence, rank_codewords(evidence, white)
