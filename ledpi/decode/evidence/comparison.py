"""What one picture says of the bands in a panel's cells, by comparison with the mean of those before.

`compared_evidence` in C (kernels/comparison.c) and, where there is no compiler, in numpy, which is the reference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ledpi.decode.cells import CellSamples
from ledpi.decode.evidence.evidence import Evidence, evidence_of, picture_slopes
from ledpi.decode.evidence.noise import lags_of
from ledpi.decode.evidence.normal import Normal, weighed, with_differences
from ledpi.decode.evidence.unlit import without_unlit
from ledpi.kernels import evidence as kernel
from ledpi.kernels.library import compiled
from ledpi.records import Frame, PanelSpec, Rejected, Singles

LEAST_SCALE = 1e-9  # of light that is none


@dataclass(frozen=True, slots=True, kw_only=True)
class Mean:
    """Some frames of one panel."""

    picture: Singles  # (cells, points) of mean 1, and above 0
    count: Singles  # (cells, points) how many showed it
    waves: Singles  # (P, cells, points) of what their waves were there


def compared_evidence(
    samples: CellSamples, frame: Frame, spec: PanelSpec, waves: Singles, mean: Mean
) -> tuple[float, Evidence | Rejected]:
    """What the samples' light is in the unit of the mean picture, and the evidence of how they differ from it.

    `waves` (P, cells, points) are the samples' own.
    """
    how = _in_c if compiled() else _numpy
    scale, found = how(samples, waves, mean)
    evidence = evidence_of(found, samples, frame, spec, len(waves))
    return scale, evidence if isinstance(evidence, Rejected) else without_unlit(evidence, samples)


def _in_c(samples: CellSamples, waves: Singles, mean: Mean) -> tuple[float, kernel.Weighed | None]:
    """`_numpy`, in C."""
    return kernel.compared_evidence(
        light=samples.light,
        valid=samples.valid,
        waves=waves,
        picture=mean.picture,
        count=mean.count,
        mean_waves=mean.waves,
        along=samples.lattice.along,
        independence=samples.independence,
        lags=lags_of(samples),
    )


def _numpy(samples: CellSamples, waves: Singles, mean: Mean) -> tuple[float, kernel.Weighed | None]:
    picture, seen = mean.picture, mean.count > 0
    both = np.asarray(seen if samples.valid is None else seen & samples.valid, np.float32)
    shown = picture * both
    scale = float((samples.light * shown).sum() / max(LEAST_SCALE, float((shown * shown).sum())))
    # The mean of n frames has a noise of its own: the difference has the variance 1 + 1/n.
    weight = shown * (mean.count / (mean.count + 1))
    root = np.sqrt(weight / max(float(weight.mean()), LEAST_SCALE))
    residual = (samples.light / np.float32(max(scale, LEAST_SCALE)) / picture - np.float32(1)) * root
    cells, points = residual.shape
    parameters = len(waves)
    shapes = ((waves - mean.waves) * root).transpose(1, 0, 2)  # (cells, P, points)
    gain_and_slopes = np.concatenate([root[None], picture_slopes(picture, samples.lattice) * root])
    nuisances = gain_and_slopes.reshape(-1, cells * points)
    information = np.zeros((cells, parameters, cells, parameters))
    each = np.arange(cells)
    information[each, :, each, :] = np.matmul(shapes, shapes.transpose(0, 2, 1))
    with_bands = np.matmul(shapes, gain_and_slopes.transpose(1, 2, 0)).reshape(cells * parameters, -1)
    normal = Normal(
        of_nuisances=(nuisances @ nuisances.T).astype(np.float64),
        of_both=with_bands.T.astype(np.float64),
        of_bands=information.reshape(cells * parameters, -1),
        nuisances=(nuisances @ residual.reshape(-1)).astype(np.float64),
        bands=np.matmul(shapes, residual[..., None]).reshape(-1).astype(np.float64),
        squares=float((residual * residual).sum()),
        freedom=int((weight > 0).sum()) - len(nuisances) - cells * parameters,
    )
    fit = weighed(normal, samples.independence)
    if fit is None:
        return scale, None
    found, factors, bands = fit
    left = residual - np.einsum("ci,cip->cp", bands.reshape(cells, -1), shapes)
    left -= (factors @ nuisances).reshape(cells, points)
    return scale, with_differences(found, left, samples)
