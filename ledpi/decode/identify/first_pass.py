"""The first pass over a panel's samples: the evidence in them, and the codewords that explain it best.

Step by step (`single_frame`, `codewords`); or all at once in C (kernels/first_pass.c), if nothing is saturated,
occluded or unlit. That is the common case in a search, where the steps in Python would take half of the time.
"""

from __future__ import annotations

from functools import cache

from ledpi.core.records import Floats, Frame, PanelSpec, Rejected, Singles
from ledpi.decode.cells import CellSamples, lattice
from ledpi.decode.evidence.erasures import UNLIT
from ledpi.decode.evidence.evidence import UNFIT, Evidence
from ledpi.decode.evidence.noise import lags_of, white_noise_expected
from ledpi.decode.evidence.occlusion import min_light_shares
from ledpi.decode.evidence.shared_light import border_points, contributing_cells, sources_of
from ledpi.decode.evidence.single_frame import single_evidence
from ledpi.decode.evidence.waves import band_prior, is_deep
from ledpi.decode.identify.codewords import SHORTLIST, rank_codewords
from ledpi.kernels import first_pass as kernel
from ledpi.kernels.codewords import Fit


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
    prior = band_prior(frame, spec) if prior is None else prior
    if samples.valid is None:
        result = _fused_pass(samples, frame, spec, white, prior)
        if result is not None:
            return result
    evidence = single_evidence(samples, frame, spec)
    if isinstance(evidence, Rejected):
        return evidence
    evidence = evidence._replace(prior=prior)
    return evidence, rank_codewords(evidence, white)


def _fused_pass(
    samples: CellSamples, frame: Frame, spec: PanelSpec, white: Singles, prior: Floats
) -> tuple[Evidence, Fit] | Rejected | None:
    """The same in C; None if it needs the steps."""
    may_be_dark = is_deep(prior)  # a deep band is as dark as what is covered
    lags = lags_of(samples)
    result = kernel.first_pass(
        _grid(samples.lattice.cells, samples.lattice.k, border_points(samples)),
        light=samples.light,
        rows=samples.rows,
        independence=samples.independence,
        lags=lags,
        noise=white_noise_expected(samples, lags, 1 + len(prior)),
        cycles_a_row=tuple(hz * frame.row_time_us * 1e-6 for hz in spec.waves_hz),
        prior=prior,
        codewords=white,
        most=SHORTLIST,
        may_be_occluded=not may_be_dark,
        unlit=0.0 if may_be_dark else UNLIT,
    )
    if isinstance(result, int):
        return UNFIT if result == kernel.UNFIT else None
    residual = 0.5 * samples.independence * result.free / result.inflation
    return Evidence(score=result.score, information=result.information, prior=prior, residual=residual), result.fit


@cache
def _grid(cells: int, k: int, border: tuple[int, int]) -> kernel.Grid:
    sources = sources_of(k, border)
    return kernel.Grid(
        *(cells, k, lattice(cells, k).along, sources.column, sources.first),
        *(contributing_cells(cells), min_light_shares(cells, k, border)),
    )
