"""The equations that the core solves, once more in numpy and as short as they can be: what tests hold it to."""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Floats
from ledpi.decode.evidence.classes import band_shares
from ledpi.decode.evidence.evidence import Evidence


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
