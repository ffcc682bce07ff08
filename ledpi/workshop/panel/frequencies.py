"""Which frequencies a panel may have: what an exposure leaves of them, flicker, the driver's timer."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ledpi.core.errors import StrEnum
from ledpi.core.shutter import contrast, harmonic_amplitude

CLOCK_HZ = 16_000_000
MAX_ERROR_PPM = 100.0  # as much as a crystal may be off by itself
MAX_CYCLES = 65_535  # the timer has 16 bits
# The interrupts of both classes, one after the other, take under 160 cycles; the rest is left to the serial line.
MIN_CYCLES = 400

# Share of the deepest bands that an exposure of this length could show, below which a frequency counts as on a null.
# The light that tells a fifth of the depth apart from noise is 25 times that of the whole.
NULL_SHARE = 0.2
# Above, bands are half as deep as those of the lowest frequency, or less: a quarter of the information.
_MAX_HZ_RATIO = 2.1
_MAX_FREQUENCIES = 16  # that pairs are made from; an exposure of 0.1 s has ten times as many lobes
# Where no null gives them places: steps, up to where bands get too narrow for the lens.
_STEP_WITHOUT_NULLS, _MAX_HZ_WITHOUT_NULLS = 1.1, 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class HalfPeriod:
    """Half a period of a square wave, as the timer counts it."""

    cycles: int
    asked_hz: float

    @property
    def frequency_hz(self) -> float:
        """Returns what the timer really makes, if its clock is exact."""
        return frequency_of(self.cycles)

    @property
    def error_ppm(self) -> float:
        """Returns how far that is above what was asked for."""
        return (self.frequency_hz / self.asked_hz - 1.0) * 1e6


def frequency_of(cycles: int) -> float:
    """Hz of a square wave whose half period takes so many cycles."""
    return CLOCK_HZ / (2 * cycles)


MIN_HZ, MAX_HZ = frequency_of(MAX_CYCLES), frequency_of(MIN_CYCLES)


def nearest_frequency(frequency_hz: float) -> float:
    """A frequency the timer makes, close to this one."""
    return frequency_of(max(MIN_CYCLES, min(MAX_CYCLES, round(CLOCK_HZ / (2.0 * frequency_hz)))))


def half_period(frequency_hz: float) -> HalfPeriod:
    """The nearest half period. Raises ValueError, with the nearest frequencies there are, where it is not near enough.

    Half a period that is now one cycle shorter and now one longer would hit any frequency on average, at the price of
    edges that jitter; it is not done.
    """
    if not math.isfinite(frequency_hz) or frequency_hz <= 0:
        raise ValueError(f"a frequency must be positive and finite, not {frequency_hz}")
    if frequency_hz < MIN_HZ * (1.0 - MAX_ERROR_PPM * 1e-6):
        raise ValueError(f"{frequency_hz:g} Hz is too slow for the timer's 16 bits; the nearest is {MIN_HZ:.4f} Hz")
    if frequency_hz > MAX_HZ * (1.0 + MAX_ERROR_PPM * 1e-6):
        raise ValueError(f"{frequency_hz:g} Hz leaves the interrupts no time; the nearest is {MAX_HZ:.4f} Hz")
    exact = CLOCK_HZ / (2.0 * frequency_hz)
    # Between two whole numbers the middle in frequency is not the middle in cycles.
    candidates = {min(max(n, MIN_CYCLES), MAX_CYCLES) for n in (math.floor(exact), math.ceil(exact))}
    found = [HalfPeriod(cycles=n, asked_hz=frequency_hz) for n in sorted(candidates, reverse=True)]
    best = min(found, key=lambda half: abs(half.error_ppm))
    if abs(best.error_ppm) > MAX_ERROR_PPM:
        nearest = " and ".join(f"{half.frequency_hz:.4f} Hz" for half in found)
        raise ValueError(
            f"{frequency_hz:g} Hz is {abs(best.error_ppm):.0f} ppm from what {CLOCK_HZ // 1_000_000} MHz can be "
            f"divided to, at most {MAX_ERROR_PPM:.0f} are allowed; the nearest are {nearest}"
        )
    return best


class Flicker(StrEnum):
    """IEEE 1789-2015's classes of light that goes fully on and off."""

    LOW_RISK = "low-risk"
    NO_EFFECT = "no-effect"

    @property
    def lowest_hz(self) -> float:
        """Its recommended practices allow 0.08 % of modulation a hertz (low risk), or 0.0333 % (no effect)."""
        return 1250.0 if self is Flicker.LOW_RISK else 3000.0


def null_share(frequency_hz: float, exposure_us: float, tolerance: float = 0.0) -> float:
    """Returns how deep the bands are, over the deepest that this exposure leaves near by; 0 on a null.

    The least of all within ± `tolerance` (relative). The deepest is where the exposure holds a whole number and a half
    of cycles, and 2 where it holds less than half of one.
    """
    ends = [frequency_hz * (1.0 - tolerance), frequency_hz * (1.0 + tolerance)]
    cycles = [hz * exposure_us * 1e-6 for hz in ends]
    if math.floor(cycles[0]) != math.floor(cycles[1]):
        return 0.0
    return min(contrast(hz, exposure_us) / min(2.0, 1.0 / c) for hz, c in zip(ends, cycles, strict=True))


def least_amplitude(frequency_hz: float, exposure_us: float, tolerance: float, duty: float) -> float:
    """Amplitude of the bands' fundamental over the mean light: the least within ± `tolerance` (relative)."""
    ends = (frequency_hz * (1.0 - tolerance), frequency_hz * (1.0 + tolerance))
    if math.floor(ends[0] * exposure_us * 1e-6) != math.floor(ends[1] * exposure_us * 1e-6):
        return 0.0
    return min(harmonic_amplitude(1, hz, exposure_us, duty) for hz in ends)


def nearest_lobe_hz(frequency_hz: float, exposure_us: float, lowest_hz: float) -> float:
    """The nearest frequency from `lowest_hz` on whose bands the exposure leaves deepest, as the timer can make it."""
    cycles = max(frequency_hz, lowest_hz) * exposure_us * 1e-6
    if cycles < 0.5:
        return _written(nearest_frequency(max(frequency_hz, lowest_hz)))
    top = _lobe_top(math.floor(cycles))
    if top < lowest_hz * exposure_us * 1e-6:
        top = _lobe_top(math.floor(cycles) + 1)
    return _written(nearest_frequency(top / exposure_us * 1e6))


def _written(frequency_hz: float) -> float:
    """With as many digits as one likes to write: less than 4 ppm off."""
    return round(frequency_hz, 2)


def _lobe_top(whole: int) -> float:
    """Cycles in the exposure at which |sinc| is largest between `whole` and the next: tan πc = πc, to second order."""
    middle = whole + 0.5
    return middle - 1.0 / (math.pi**2 * middle)


def worthwhile_frequencies(exposure_us: float, lowest_hz: float) -> list[float]:
    """The frequencies from which pairs are made: between two nulls the best, as the timer can make it.

    An exposure so short that there are no nulls leaves nearly all of any frequency; steps of a tenth from the lowest.
    """
    per_hz = exposure_us * 1e-6
    if lowest_hz * per_hz < 1.0:
        highest_hz = _MAX_HZ_WITHOUT_NULLS * lowest_hz
        steps = int(math.log(_MAX_HZ_WITHOUT_NULLS) / math.log(_STEP_WITHOUT_NULLS))
        ideal = [lowest_hz * _STEP_WITHOUT_NULLS**k for k in range(steps + 1)]
    else:
        highest_hz = _MAX_HZ_RATIO * lowest_hz
        lobes = range(math.floor(lowest_hz * per_hz), math.ceil(highest_hz * per_hz) + 1)
        ideal = [_lobe_top(whole) / per_hz for whole in lobes]
    made = [_written(nearest_frequency(hz)) for hz in ideal]
    tried = [hz for hz in made if lowest_hz <= hz <= highest_hz]
    return tried[:: math.ceil(len(tried) / _MAX_FREQUENCIES)]


def off_mains_hz(frequency_hz: float) -> float:
    """Distance to the nearest harmonic of 100 or of 120 Hz, at which lamps on the mains flicker."""
    return min(abs(frequency_hz - mains * round(frequency_hz / mains)) for mains in (100.0, 120.0))
