"""Docks before panel 7 as a program beside ledpi, as firmware/drive/dock.c does: with its configuration, and

    python -m examples.tap_dock

The panel is the map: it hangs at the origin, and faces along −x.
"""

from __future__ import annotations

import math
from cmath import phase
from collections.abc import Generator

from examples.tap_robot import FASTEST_M_S, STAND, Motion, Seen, Steering, main, toward

GOAL, PANEL_M = -0.60, 0.60  # base_link's x before the panel, and how far ahead of that the panel is
VIEW_RAD = 0.26  # so far aside of the middle of the picture the panel may be
WITHIN_M, WITHIN_RAD = 0.003, 0.005
LOOK_S = 0.6  # until the robot stands, and a picture of that has been seen
PULSE_M_S, PULSE_RAD_S = 0.045, 0.3  # however the motors lag, a pulse moves by speed times time
TRIES, BACK_M = 5, 0.45  # how often and how far it backs up


def clip(value: float, most: float) -> float:
    return max(-most, min(most, value))


def approach(seen: Seen) -> Motion | None:
    """To a point of the goal's axis, nearer as it comes closer, with the panel in view; first it must see that."""
    at, yaw = seen.ahead()
    left, panel = GOAL - at.real, phase(GOAL + PANEL_M - at)
    if left < 0.002:
        return None
    if seen.is_vague(left, 0.02):
        return 0.0, clip(2 * math.remainder(panel - yaw, math.tau), 1.0)
    aim = math.atan2(-at.imag, max(0.12, min(0.6, 0.45 * left + 0.10)))
    return toward(math.remainder(panel + clip(aim - panel, VIEW_RAD) - yaw, math.tau), min(FASTEST_M_S, 1.2 * left))


def is_vague(seen: Seen) -> bool:
    """Tells whether where it is is too uncertain to go on, also backwards; else it stands."""
    return seen.is_vague(abs(GOAL - seen.ahead(0)[0].real), 0.02)


def hold(motion: Motion, seconds: float, seen: Seen) -> Generator[Motion, Seen, Seen]:
    ends_ns = seen.now_ns + seconds * 1e9
    while seen.now_ns < ends_ns or is_vague(seen):
        seen = yield STAND if is_vague(seen) or seen.now_ns >= ends_ns else motion
    return seen


def dock() -> Steering:
    """Drives up, stands, looks, and mends by pulses. Wheels cannot mend what is left aside: for that it backs up."""
    seen = yield STAND
    for tries in range(TRIES, -1, -1):
        while motion := approach(seen):
            seen = yield motion
        while True:
            seen = yield from hold(STAND, LOOK_S, seen)
            at, yaw = seen.ahead(0)
            left = GOAL - at.real
            if abs(at.imag) > WITHIN_M and tries:
                break
            if abs(yaw) > WITHIN_RAD:
                seen = yield from hold((0.0, math.copysign(PULSE_RAD_S, -yaw)), abs(yaw) / PULSE_RAD_S, seen)
            elif abs(left) > WITHIN_M:
                seen = yield from hold((math.copysign(PULSE_M_S, left), 0.0), abs(left) / PULSE_M_S, seen)
            else:
                return
        while GOAL - at.real < BACK_M:
            seen = yield STAND if is_vague(seen) else (-0.15, 2 * (clip(2 * at.imag, 0.25) - yaw))
            at, yaw = seen.ahead()


if __name__ == "__main__":
    main(dock())
