"""Faults of a pair of frequencies and a frame period, each with what would be right."""

from __future__ import annotations

from dataclasses import dataclass

from ledpi.camera.timing import choose_frame_length_rows
from ledpi.core.records import Phase
from ledpi.core.shutter import contrast, phase_advance_cycles
from ledpi.workshop.panel.design import FROZEN_CYCLES, Task
from ledpi.workshop.panel.frequencies import NULL_SHARE, half_period, nearest_lobe_hz, null_share, off_mains_hz

_NEAR_MAINS_HZ = 5.0


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing to know of a pair."""

    unusable: bool  # else it is only worth knowing
    text: str


def findings(
    task: Task, black_hz: float, white_hz: float, frame_length_rows: int, phase: Phase = "free"
) -> list[Finding]:
    """All that speaks against the pair, the worst first; empty where nothing does."""
    found = []
    both = phase == "antiphase" and black_hz == white_hz
    classes = [("both", black_hz)] if both else [("black", black_hz), ("white", white_hz)]
    for name, hz in classes:
        found += [Finding(True, f"{name}, {hz:g} Hz: {text}") for text in _frequency_findings(task, hz)]
    if phase == "free":
        found += [Finding(True, text) for text in _pair_findings(task, black_hz, white_hz)]
    elif not both:
        found.append(Finding(True, f"in antiphase both classes blink alike, not at {black_hz:g} and {white_hz:g} Hz"))
    found += [Finding(True, text) for text in _frozen(task, [hz for _, hz in classes], frame_length_rows)]
    for name, hz in classes:
        if off_mains_hz(hz) < _NEAR_MAINS_HZ:
            found.append(
                Finding(
                    False,
                    f"{name}, {hz:g} Hz: {off_mains_hz(hz):.0f} Hz from a harmonic of the mains' 100 or 120 Hz; a lamp "
                    "that is switched rather than smoothed may show there",
                )
            )
    return found


def _frequency_findings(task: Task, hz: float) -> list[str]:
    exposure_us, lowest_hz = task.sensor.exposure_us, task.flicker.lowest_hz
    near_hz = nearest_lobe_hz(hz, exposure_us, lowest_hz)
    better = f"the nearest good one is {near_hz:.2f} Hz"
    if null_share(near_hz, exposure_us, task.tolerance) < NULL_SHARE:
        better = f"none near by is good with oscillators within ± {1e6 * task.tolerance:g} ppm; a crystal's are 100"
    found = []
    if hz < lowest_hz:
        found.append(
            f"flickers: light that goes fully on and off is {task.flicker.value} (IEEE 1789) from {lowest_hz:g} Hz on; "
            + better
        )
    share = null_share(hz, exposure_us, task.tolerance)
    if share < NULL_SHARE:
        cycles = hz * exposure_us * 1e-6
        spread = f" ± {task.tolerance * cycles:.2g}" if task.tolerance * cycles >= 0.01 else ""
        found.append(
            f"on a null: the exposure of {exposure_us:.0f} µs holds {cycles:.2f}{spread} of its cycles, and whole ones "
            f"leave no bands ({100 * contrast(hz, exposure_us, task.duty):.1f} % deep here); {better}"
        )
    if hz * task.sensor.row_time_us * 1e-6 >= 0.5:
        found.append(
            f"too fast: its bands are {0.5e6 / hz / task.sensor.row_time_us:.2f} rows high, less than one; must be "
            f"below {0.5e6 / task.sensor.row_time_us:.0f} Hz"
        )
    try:
        half_period(hz)
    except ValueError as error:
        found.append(f"the driver's timer cannot make it: {error}")
    return found


def _pair_findings(task: Task, black_hz: float, white_hz: float) -> list[str]:
    least_hz = task.least_apart_hz(black_hz, white_hz)
    if abs(white_hz - black_hz) > least_hz:
        return []
    good = nearest_lobe_hz(2 * black_hz, task.sensor.exposure_us, task.flicker.lowest_hz)
    return [
        f"{black_hz:g} and {white_hz:g} Hz coincide: their bands look alike; must be {least_hz:.0f} Hz apart at the "
        "very least, to drift by a cycle over a whole picture and whatever the oscillators do; "
        f"with {black_hz:g} Hz a good one is {good:.2f} Hz"
    ]


def _frozen(task: Task, frequencies_hz: list[float], rows: int) -> list[str]:
    """A class whose bands stand still from frame to frame, and the period that would move them."""
    row_time_us = task.sensor.row_time_us
    period_us = rows * row_time_us
    frozen = [hz for hz in frequencies_hz if abs(phase_advance_cycles(hz, period_us)) < FROZEN_CYCLES]
    if not frozen:
        return []
    try:
        moving = choose_frame_length_rows(shortest_rows=rows, row_time_us=row_time_us, frequencies_hz=frequencies_hz)
        moving_us = moving * row_time_us
        cure = f"a frame of {moving_us:.0f} µs ({moving} rows, {1e6 / moving_us:.2f} fps) moves both"
    except ValueError:
        cure = "no frame period moves both"
    return [
        f"{hz:g} Hz is frozen at {1e6 / period_us:.3f} fps: it advances by {hz * period_us * 1e-6:.4f} cycles a frame, "
        f"so every frame shows the same bands, and further frames tell nothing new of its cells; {cure}"
        for hz in frozen
    ]
