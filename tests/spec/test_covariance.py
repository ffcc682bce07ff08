"""The covariance of a panel's corners is that of their errors."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.core.records import Rejected
from ledpi.decode.model.fit import FitOptions, Fitter
from tests.builders.decode import SPEC, TRUE_10_MS_US, square
from tests.builders.model import Panel, nees, window_of

FITTER = Fitter(4, None)
WHOLE = FitOptions(rounds=10, reweightings=2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("side", "exposure_us"), [(50, 150.0), (100, TRUE_10_MS_US), (24, TRUE_10_MS_US), (100, 600.0)]
)
def test_the_covariance_is_that_of_the_errors(side: float, exposure_us: float) -> None:
    """Takes 30 places, phases and draws of noise: the median of a squared normalised error in eight dimensions is 7.3.

    Or less, as the fit allows for rims, light aside and walls before the diffuser, which are not drawn here.
    """
    squares = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        corners = square(*rng.uniform(80, 81, 2), side, 90 * rng.random())
        black, white = rng.random(2)
        panel = Panel(corners=corners, exposure_us=exposure_us, phases=(black, white))
        fit = FITTER.fit(panel.frame(), window_of(panel.light(), noise=0.05, seed=seed), corners + 0.2, SPEC, WHOLE)
        assert not isinstance(fit, Rejected), fit.key
        squares.append(nees(fit, corners))
    assert 2.0 < np.median(squares) < 12.0
