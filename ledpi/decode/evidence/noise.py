"""Noise that neighbouring pixels share, and what that leaves of the evidence.

Evidence counts samples as if each pixel had noise of its own. A camera's processor that takes noise off, interpolates
colours or scales the picture makes neighbours alike: of white noise the fine part is gone, and what is left of the
light looks quieter than bands find it, which are coarse. Three in four of what odds claim may then be noise.

What a fit has left of the light tells. Let D(a) be the mean squared difference of two samples of a cell that are a
pixels apart, along rows and columns of the lattice, and

    r = 1 − D(1)/D(2)

the nearer one's likeness; what is slow, as errors of the static picture are, is in neither. In white noise r is r₀:
not 0, as samples are interpolated, and as the fit takes the coarse part of the noise with it. Both are known: of
samples with the covariance R the fit leaves M R M, M = 1 − F(FᵀF)⁻¹Fᵀ, with F what is fitted to a cell, about as many
polynomials of the picture's row as there are bands and gains.

Where noise was blurred, r is more, and bands meet more of it than the squares of what is left tell, by exp(g·(r − r₀));
g is what a blur of half a pixel makes it, and about the same for others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from ledpi.decode.evidence.cells import INSET, CellSamples
from ledpi.decode.evidence.white_noise import ROUNDED_PX, Lags, Step, lattice_statistics, likeness, pair_count

# At a cell's rim walls stand, of which no model tells all: what is left there is light as much as noise. Of small cells
# that is all there is; but only frames' differences tell of them, in which walls are not.
LEAST_WITH_RIM = 6
FURTHEST_PX = 2.0  # noise that far apart is not alike in any picture: what is so there is light that was not explained
# Where what cells share takes more than this of what the fit of each leaves, r₀ is another one.
LEAST_FREE = 0.5
# With a deviation of ln(inflation) that is more than this, r tells nothing: cells of 3 × 3 samples, all fitted.
MOST_UNSURE = 0.7


@dataclass(frozen=True, slots=True)
class Correlation:
    """The correlation of the noise of one fit's residual, or of several."""

    excess: float  # r − r₀
    deviation: float  # of that, by chance, in white noise
    growth: float  # g

    @property
    def inflation(self) -> float:
        """By how much evidence claims too much: 1 or more; as far as the excess is more than a deviation."""
        if not self.deviation * self.growth < MOST_UNSURE:
            return 1.0
        return math.exp(max(0.0, self.growth * (self.excess - self.deviation)))


WHITE = Correlation(0.0, 0.0, 0.0)


def lags_of(samples: CellSamples) -> Lags:
    """More than one where a panel is seen at an angle; 0 where samples are further apart than noise is alike."""
    k, (width, height) = samples.lattice.k, samples.cell_px
    rim = 1 if k >= LEAST_WITH_RIM else 0
    most = (k - 2 * rim - 1) // 2
    return Lags(_lag(width * (1 - 2 * INSET) / k, most), _lag(height * (1 - 2 * INSET) / k, most), rim)


def _lag(step_px: float, most: int) -> int:
    return 0 if step_px > FURTHEST_PX else min(most, max(1, round(1 / step_px)))


class WhiteNoise(NamedTuple):
    """The values that white noise would give; and what tells how sure that is."""

    white: float  # r₀
    growth: float  # g
    chance: float  # deviation of r, in white noise, times the root of how many samples are free
    once: float  # differences of samples a lag apart
    twice: float  # and of those two lags apart
    least_free: float  # samples: where fewer are, r₀ is another one

    def correlation(self, near: float, far: float, free_samples: float) -> Correlation:
        """Returns that of noise in a fit that has left these sums of squared differences, a lag and two lags apart."""
        if not (far > 0.0 and free_samples >= self.least_free):
            return WHITE
        alike = 1.0 - (near / self.once) / (far / self.twice)
        return Correlation(alike - self.white, self.chance / math.sqrt(free_samples), self.growth)


NOTHING = WhiteNoise(0.0, 0.0, 0.0, 1.0, 1.0, math.inf)


def white_noise_expected(samples: CellSamples, lags: Lags, fitted: int) -> WhiteNoise:
    """Computes those of these samples, where `fitted` functions are fitted to each cell; `lags`: of the differences."""
    steps, k = _steps_of(samples), samples.lattice.k
    of_white = lattice_statistics(k, lags, _rounded(steps[0]), _rounded(steps[1]), fitted, samples.linear)
    if of_white is None:
        return NOTHING
    by_fit, growth, free = of_white
    usual = free * samples.light.size * (1.0 if samples.valid is None else float(samples.valid.mean()))
    once, twice = len(samples.light) * pair_count(k, lags, 1), len(samples.light) * pair_count(k, lags, 2)
    return WhiteNoise(
        white=by_fit + likeness(*steps, lags, samples.linear),
        growth=growth,
        chance=free * math.sqrt((1.0 / once + 1.0 / twice) * free * samples.light.size),
        once=once,
        twice=twice,
        least_free=LEAST_FREE * usual,
    )


def _rounded(step: Step) -> Step:
    return round(step[0] / ROUNDED_PX) * ROUNDED_PX, round(step[1] / ROUNDED_PX) * ROUNDED_PX


def _steps_of(samples: CellSamples) -> tuple[Step, Step]:
    """From one sample to the next, across and down the lattice, in pixels; mirrored, which is alike, so
    that all but one of these are not negative."""
    n, k = samples.lattice.cells, samples.lattice.k
    rows, along = samples.rows, samples.lattice.along
    a_cell = (1 - 2 * INSET) / k
    per_side = a_cell / n / (along.item(-1) - along.item(0))
    first = rows.item(0)
    aside = abs(rows.item(n - 1, k - 1) - first) * per_side
    below = abs(rows.item(n * (n - 1), k * (k - 1)) - first) * per_side
    across = math.sqrt(max(0.0, (samples.cell_px[0] * a_cell) ** 2 - aside * aside))
    down = math.sqrt(max(0.0, (samples.cell_px[1] * a_cell) ** 2 - below * below))
    return (across, aside), (-down, below)
