"""Which frequencies the driver's timer makes: half a period is a whole number of clock cycles, f = clock / (2·n)."""

from __future__ import annotations

import math
from dataclasses import dataclass

CLOCK_HZ = 16_000_000
MAX_ERROR_PPM = 100.0  # as much as a crystal may be off by itself
MAX_CYCLES = 65_535  # the timer has 16 bits
# The interrupts of both classes, one after the other, take under 160 cycles; the rest is left to the serial line.
MIN_CYCLES = 400


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
