"""The equations that the core solves, once more in numpy and as short as they can be: what tests hold it to."""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Floats, Singles
from ledpi.decode.evidence.band_estimate import BandEstimate
from ledpi.decode.evidence.cells import CellSamples, Lattice
from ledpi.decode.evidence.classes import band_shares
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.shared_light import border_points, contributing_cells, sources_of


def weighed(design: Floats, residual: Floats, shared: Floats, bands: int, free: int) -> tuple[Floats, Floats]:
    """Score (bands,) and information (bands, bands) of the last columns of a design (samples, unknowns).

    `shared` (samples, …), orthonormal, is projected out of it, as it has been of the residual; the other columns are
    eliminated; over the variance that is left when the bands fit best, `free` samples being free.
    """
    of_shared = shared.T @ design
    matrix, right = design.T @ design - of_shared.T @ of_shared, design.T @ residual
    first = slice(0, len(matrix) - bands)
    last = slice(len(matrix) - bands, None)
    taken = np.linalg.solve(ridged(matrix[first, first]), np.column_stack([matrix[first, last], right[first]]))
    score = right[last] - matrix[last, first] @ taken[:, -1]
    information = matrix[last, last] - matrix[last, first] @ taken[:, :-1]
    explained = right[first] @ taken[:, -1] + score @ np.linalg.solve(ridged(information), score)
    variance = (residual @ residual - explained) / free
    return score / variance, information / variance


def ridged(matrix: Floats) -> Floats:
    return matrix + (1e-5 * np.trace(matrix) / len(matrix) + 1e-12) * np.eye(len(matrix))


def slopes_of(picture: Floats, lattice: Lattice) -> Floats:
    """(8, cells, points): how the logarithm of a picture changes for each way in which its corners can be off."""
    n, k = lattice.cells, lattice.k
    whole = np.log(picture).reshape(n, n, k, k).transpose(0, 2, 1, 3).reshape(n * k, n * k)
    down, across = (
        np.asarray(each).reshape(n, k, n, k).transpose(0, 2, 1, 3).reshape(n * n, k * k)
        for each in np.gradient(whole, lattice.along, lattice.along)
    )
    x, y = 2.0 * lattice.u - 1, 2.0 * lattice.v - 1
    radial = x * across + y * down
    return np.stack([across, x * across, y * across, down, x * down, y * down, x * radial, y * radial])


def block_columns(shapes: Floats) -> Floats:
    """(cells·points, cells·P): each cell's own `shapes` (P, cells, points), 0 in all others."""
    parameters, cells, points = shapes.shape
    columns = np.zeros((cells, points, cells, parameters))
    each = np.arange(cells)
    columns[each, :, each, :] = shapes.transpose(1, 2, 0)
    return columns.reshape(cells * points, cells * parameters)


def levels(light: Floats, share: Floats, valid: Floats) -> tuple[Floats, Floats]:
    """Gain (cells,) and profile (points,) whose product, times `share`, is the light where that is valid."""
    gain = (light.sum(axis=1) / share.sum(axis=1))[:, None]
    if (share == 1.0).all():
        return gain[:, 0], (light / gain).mean(axis=0)
    for _ in range(3):
        profile = light.sum(axis=0) / np.maximum((gain * share).sum(axis=0), 1e-9)
        gain = (light.sum(axis=1) / (profile * share).sum(axis=1))[:, None]
    profile[~valid.any(axis=0)] = profile.max()
    return gain[:, 0], profile


def shared_basis(samples: CellSamples, gain: Floats, root: Floats, estimate: BandEstimate | None) -> Floats:
    """(cells·points, …) orthonormal: what the cells that meet at each point may send there, over the root."""
    (cells, points), lattice = samples.light.shape, samples.lattice
    sources, meet = sources_of(lattice.k, border_points(samples)), contributing_cells(lattice.cells)
    ends, basis = [*sources.first[1:], len(sources.column)], []
    for p, (begin, end) in enumerate(zip(sources.first, ends, strict=True)):
        kept: list[Floats] = []
        for column in sources.column[begin:end]:
            others = np.minimum(meet[:, column], cells - 1)
            sent = np.where(meet[:, column] < cells, gain[others], 0.0) / root[:, p]
            if estimate is not None:
                sent *= np.where(estimate.white[others], estimate.light[1][:, p], estimate.light[0][:, p])
            own = sent - sum((sent @ other) * other for other in kept)
            if np.linalg.norm(own) > 1e-3 * np.linalg.norm(sent):
                kept.append(own / np.linalg.norm(own))
        for own in kept:
            basis.append(np.zeros((cells, points)))
            basis[-1][:, p] = own
    return np.stack(basis).reshape(len(basis), -1).T


def single_frame_evidence(samples: CellSamples, waves: Singles, estimate: BandEstimate | None) -> tuple[Floats, Floats]:
    """Score and information as decode/evidence/single_frame.py has them, but for the variance of the noise."""
    light, (cells, _) = samples.light.astype(np.float64), samples.light.shape
    shown = np.ones_like(light) if estimate is None else estimate.band_light().astype(np.float64)
    valid = np.ones(light.shape) if samples.valid is None else samples.valid.astype(np.float64)
    gain, profile = levels(light, shown * valid, valid)
    light = np.where(valid > 0, light, gain[:, None] * profile * shown) / gain.mean()
    gain = gain / gain.mean()
    root = np.sqrt(gain[:, None] * np.maximum(profile, 1e-3) * shown)
    basis, seen = shared_basis(samples, gain, root, estimate), (light / root).ravel()
    static = (basis @ (basis.T @ seen)).reshape(light.shape)
    residual = (seen - static.ravel()) * valid.ravel()
    static = np.maximum(static, 0.02)
    corners = slopes_of(static / shown * root, samples.lattice) * static
    design = np.concatenate(
        [block_columns(static[None]), corners.reshape(8, -1).T, block_columns(waves * static / shown)], axis=1
    )
    unknowns = len(sources_of(samples.lattice.k, border_points(samples)).column) - 1 + design.shape[1]
    free = int(valid.sum()) - unknowns
    score, information = weighed(design * valid.reshape(-1, 1), residual, basis, cells * len(waves), free)
    return samples.independence * score, samples.independence * information


def word_log_likelihoods(evidence: Evidence, white: np.ndarray) -> tuple[Floats, Floats, Floats]:
    """Log-likelihood ratio of each word (W, cells) to "no bands", as decode/identify/codewords.py has it.

    Also the bands' most probable values (W, P) and covariance (W, P, P).
    """
    shares = band_shares(white.astype(np.float64), len(evidence.prior))  # (W, cells, P)
    normal = np.einsum("wci,cidj,wdj->wij", shares, evidence.information, shares, optimize=True)
    normal += np.diag(1.0 / evidence.prior)
    score = (shares * evidence.score).sum(axis=1)
    covariance = np.asarray(np.linalg.inv(normal), np.float64)
    bands = np.asarray((covariance @ score[..., None])[..., 0], np.float64)
    log_det = np.linalg.slogdet(normal)[1] + np.log(evidence.prior).sum()
    return 0.5 * ((bands * score).sum(axis=1) - log_det), bands, covariance
