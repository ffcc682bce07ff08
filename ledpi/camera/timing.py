"""Whole rows: a sensor's exposure and frame period, and which period keeps the bands moving. Pure."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from ledpi.shutter import phase_advance_cycles

# Subtracting one frame from the next removes the still picture. Of a band's sine of amplitude a that advances
# by δ cycles it leaves one of amplitude 2a·|sin πδ|, as sin(x + 2πδ) − sin x = 2 sin πδ · cos(x + πδ). From
# δ = 1/6 on that is at least a: the difference shows the bands no weaker than one frame does. It costs only
# a few rows more than a smaller bound would.
MIN_PHASE_ADVANCE_CYCLES = 1 / 6
# Far away, where a cell is a small part of a band, only the advance tells one class's bands from the other's, and not
# whether it is up or down. 1/12 takes them half a cycle apart in six frames. It is worth a tenth of the frame rate.
MIN_DIFFERENCE_CYCLES, WORTH_LONGER = 1 / 12, 1.1


def choose_frame_length_rows(
    *, shortest_rows: int, row_time_us: float, frequencies_hz: Sequence[float]
) -> int:
    """The shortest frame, in rows, over which every phase advances by 1/6 cycle or more from an integer.

    Or one that is up to a tenth longer, if in that one no two classes advance alike. Looks at whole rows from
    `shortest_rows` to twice that. Raises ValueError where no length suits.
    """
    moving = [
        rows
        for rows in range(shortest_rows, 2 * shortest_rows + 1)
        if all(abs(phase_advance_cycles(f, rows * row_time_us)) >= MIN_PHASE_ADVANCE_CYCLES for f in frequencies_hz)
    ]
    if moving:
        near = (rows for rows in moving if rows <= WORTH_LONGER * moving[0])
        return next((rows for rows in near if _unlike(frequencies_hz, rows * row_time_us)), moving[0])
    named = ", ".join(f"{f:g}" for f in frequencies_hz)
    raise ValueError(
        f"no frame of {shortest_rows} to {2 * shortest_rows} rows of {row_time_us:g} µs keeps the phases of "
        f"{named} Hz all moving; set camera.frame_duration_us"
    )


def _unlike(frequencies_hz: Sequence[float], period_us: float) -> bool:
    """Whether no two frequencies advance alike; those less than a frame rate apart are one class's, of two panels."""
    return all(
        abs(phase_advance_cycles(one + sign * other, period_us)) >= MIN_DIFFERENCE_CYCLES
        for one, other in itertools.combinations(frequencies_hz, 2)
        if abs(one - other) * period_us >= 1e6
        for sign in (1.0, -1.0)
    )


def frame_duration_us(rows: int, row_time_us: float) -> int:
    """What to ask libcamera for, in whole µs, to get a frame of `rows`.

    It rounds down to whole rows. A quarter of a row more than needed outweighs the error of a row time that
    was itself derived from whole µs.
    """
    return round((rows + 0.25) * row_time_us)


def exposure_honoured(*, asked_us: float, reported_us: float, row_time_us: float) -> bool:
    """Whether the sensor exposes as asked: whole rows, rounded down, reported in µs, rounded down."""
    return math.floor(asked_us - row_time_us) <= reported_us <= asked_us
