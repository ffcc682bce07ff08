"""Whole rows: a sensor's exposure and frame period, and which period keeps the bands moving. Pure."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from ledpi.core.shutter import phase_advance_cycles

# Subtracting one frame from the next removes the still picture. Of a band's sine of amplitude a that advances
# by δ cycles it leaves one of amplitude 2a·|sin πδ|, as sin(x + 2πδ) − sin x = 2 sin πδ · cos(x + πδ). From
# δ = 1/6 on that is at least a: the difference shows the bands no weaker than one frame does. It costs only
# a few rows more than a smaller bound would.
MIN_PHASE_ADVANCE_CYCLES = 1 / 6
# Far away, where a cell is a small part of a band, only the advance tells one class's bands from the other's, and not
# whether it is up or down. 1/12 takes them half a cycle apart in six frames. It is worth a tenth of the frame rate.
MIN_DIFFERENCE_CYCLES, WORTH_LONGER = 1 / 12, 1.1
# An oscillator without a quartz is off by so much. At 1250 Hz that is 0.2 cycles a frame, at 2450 Hz 0.4: either class
# may stand still for that, but a period can see to it that never both do. One that moves is enough to read by.
OSCILLATOR_ERROR = 0.01


def choose_frame_length_rows(*, shortest_rows: int, row_time_us: float, frequencies_hz: Sequence[float]) -> int:
    """The shortest frame, in rows, over which every phase advances by 1/6 cycle or more from an integer.

    A frame of up to a tenth more rows is preferred if no two classes advance alike in it; and of these the first in
    which oscillators that are off by 1 % do not stop both classes. Looks at whole rows from `shortest_rows` to twice
    that. Raises ValueError where no length suits.
    """
    moving = [
        rows
        for rows in range(shortest_rows, 2 * shortest_rows + 1)
        if all(abs(phase_advance_cycles(f, rows * row_time_us)) >= MIN_PHASE_ADVANCE_CYCLES for f in frequencies_hz)
    ]
    if moving:
        near = [rows for rows in moving if rows <= WORTH_LONGER * moving[0]]
        unlike = [rows for rows in near if _unlike(frequencies_hz, rows * row_time_us)]
        sure = [rows for rows in unlike if _surely_moving(frequencies_hz, rows * row_time_us)]
        return (sure or unlike or moving)[0]
    named = ", ".join(f"{f:g}" for f in frequencies_hz)
    raise ValueError(
        f"no frame of {shortest_rows} to {2 * shortest_rows} rows of {row_time_us:g} µs keeps the phases of "
        f"{named} Hz all moving; set camera.frame_duration_us"
    )


def _unlike(frequencies_hz: Sequence[float], period_us: float) -> bool:
    """Tells whether no two classes advance alike."""
    return all(
        abs(phase_advance_cycles(one + sign * other, period_us)) >= MIN_DIFFERENCE_CYCLES
        for one, other in _two_classes(frequencies_hz, period_us)
        for sign in (1.0, -1.0)
    )


def _surely_moving(frequencies_hz: Sequence[float], period_us: float) -> bool:
    """Tells whether of any two classes one moves though its oscillator is off; of a single class, whether that does."""
    moving = {hz for hz in frequencies_hz if _moves_though_off(hz, period_us)}
    pairs = _two_classes(frequencies_hz, period_us)
    return all(not moving.isdisjoint(pair) for pair in pairs) if pairs else moving.issuperset(frequencies_hz)


def _moves_though_off(frequency_hz: float, period_us: float) -> bool:
    off_cycles = OSCILLATOR_ERROR * frequency_hz * period_us * 1e-6
    return abs(phase_advance_cycles(frequency_hz, period_us)) >= MIN_DIFFERENCE_CYCLES + off_cycles


def _two_classes(frequencies_hz: Sequence[float], period_us: float) -> list[tuple[float, float]]:
    """Pairs of different classes' frequencies; those less than a frame rate apart are one class's, of two panels."""
    pairs = itertools.combinations(frequencies_hz, 2)
    return [(one, other) for one, other in pairs if abs(one - other) * period_us >= 1e6]


def frame_duration_us(rows: int, row_time_us: float) -> int:
    """Returns what to ask libcamera for, in whole µs, to get a frame of `rows`.

    It rounds down to whole rows. A quarter of a row more than needed outweighs the error of a row time that
    was itself derived from whole µs.
    """
    return round((rows + 0.25) * row_time_us)


def exposure_honoured(*, asked_us: float, reported_us: float, row_time_us: float) -> bool:
    """Tells whether the sensor exposes as asked: whole rows, rounded down, reported in µs, rounded down."""
    return math.floor(asked_us - row_time_us) <= reported_us <= asked_us
