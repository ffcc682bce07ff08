"""The conditions of `table.md`, and their pictures. Truth is what was painted; nothing is asked of the decoder."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np

from ledpi.core.records import Floats, Frame, Intrinsics
from tests.builders.decode import (
    FRAME_ROWS,
    LENS,
    PHASES,
    PINHOLE,
    ROW_TIME_US,
    Bits,
    Canvas,
    Profile,
    bare,
    diffuser,
    flat,
    one_size,
    seen_through,
    square,
    word,
)

FOCAL_PX, SIDE_M = 640.0, 0.16
PERIOD_US = FRAME_ROWS * ROW_TIME_US
CENTRE = (310.3, 240.6)
Painter = Callable[[Canvas, Floats, int], None]  # into the canvas, beside a panel with these corners, in frame n


@dataclass(frozen=True)
class Condition:
    """A panel: how it is built and hangs, and what is around it."""

    ids: tuple[int, ...] = (7,)  # of the panel; of frames alone they take turns
    also: tuple[int, ...] = ()  # others that `behind` paints
    profile: Profile = diffuser
    light: float = 0.4
    cells: Callable[[int], Bits] | None = None  # in the word's place, of frame n
    gains: Floats | None = None
    centre: tuple[float, float] = CENTRE
    turn_deg: float = 13.0
    turned_on_deg: float = 0.0  # from frame to frame
    yaw_deg: float = 0.0
    step_px: float = 0.0  # to the right, from frame to frame
    lens: Intrinsics = PINHOLE
    background: float = 0.03
    behind: Painter | None = None
    before: Painter | None = None
    gone_from: int | None = None  # the first frame that does not show the panel
    steeper: float = 1.0  # bands than the exposure that is told makes them
    smoothing_px: float = 0.0  # over rows

    def straight(self, distance_m: float, n: int) -> Floats:
        """(4, 2) corners in frame n, as a lens without distortion shows them."""
        turned = square(0, 0, SIDE_M, self.turn_deg + n * self.turned_on_deg)
        yaw = math.radians(self.yaw_deg)
        depth_m = distance_m + turned[:, :1] * math.sin(yaw)
        centre = np.array((self.centre[0] + n * self.step_px, self.centre[1]))
        return np.asarray(centre + FOCAL_PX * turned * (math.cos(yaw), 1.0) / depth_m)

    def corners(self, distance_m: float, n: int) -> Floats:
        """(4, 2) corners in frame n, in the picture."""
        straight = self.straight(distance_m, n)
        return straight if self.lens is PINHOLE else seen_through(self.lens, straight)

    def shown(self, n: int) -> tuple[int, ...]:
        """IDs that are in frame n, in ascending order; the panel's is the first where it is alone."""
        gone = self.cells is not None or (self.gone_from is not None and n >= self.gone_from)
        return tuple(sorted((() if gone else (self.ids[n % len(self.ids)],)) + self.also))


def frame(condition: Condition, exposure_us: float, distance_m: float, n: int, *, stream: bool) -> Frame:
    """Frame n; in a stream, oscillators run on from the last one, and otherwise begin anywhere."""
    phases = PHASES if stream else tuple(np.random.default_rng(n).random(2).tolist())
    canvas, true = Canvas(background=condition.background, exposure_us=exposure_us / condition.steeper), None
    true = condition.straight(distance_m, n)
    if condition.behind is not None:
        condition.behind(canvas, true, n)
    if condition.gone_from is None or n < condition.gone_from:
        canvas.panel(
            true,
            word(condition.ids[n % len(condition.ids)]) if condition.cells is None else condition.cells(n),
            light=condition.light,
            profile=condition.profile,
            gains=condition.gains,
            phases=(phases[0], phases[1]),
            start_us=n * PERIOD_US if stream else 0.0,
            lens=None if condition.lens is PINHOLE else condition.lens,
        )
    if condition.before is not None:
        condition.before(canvas, true, n)
    made = replace(canvas.frame(n, seq=n), exposure_us=exposure_us)
    if condition.smoothing_px:
        smooth = cv2.GaussianBlur(made.pixels, (1, 9), 1e-6, None, condition.smoothing_px)
        made = replace(made, pixels=np.asarray(smooth, dtype=np.uint8))
    return made


# ---- What is around panels


def around(light: float) -> Painter:
    """A steady frame, a twentieth of the side wide."""
    return lambda canvas, true, _: canvas.lamp(true.mean(axis=0) + 1.1 * (true - true.mean(axis=0)), light)


def hiding(share: float) -> Painter:
    """Something dark before so much of the panel, along its left side."""

    def paint(canvas: Canvas, true: Floats, _: int) -> None:
        a, b, c, d = true
        out, up = 0.3 * (a - b), 0.2 * (a - d)
        upper, lower = a + share * (b - a), d + share * (c - d)
        canvas.lamp(np.array([a + out + up, upper + up, lower - up, d + out - up]), 0.0)

    return paint


def sheets(canvas: Canvas, true: Floats, _: int) -> None:
    """One as bright as the rim of the panel's cells to the left, a brighter one below; they touch it."""
    across, down = true[1] - true[0], true[3] - true[0]
    canvas.lamp(true - across, 0.28)
    canvas.lamp(true + down, 0.6)


def bright_room(canvas: Canvas, _: Floats, __: int) -> None:
    """A wall that is brighter to the right, and a lamp on it."""
    canvas.light += np.linspace(0, 0.1, 640)
    canvas.lamp(square(520, 150, 150), 0.95)


def three_more(canvas: Canvas, _: Floats, __: int) -> None:
    """A near panel, and two neighbours with half a cell of wall between them."""
    canvas.panel(square(120, 130, 160, 7), word(7))
    canvas.panel(square(350, 110, 80, -5), word(23))
    canvas.panel(square(440, 110, 80, -5), word(12))


def sixty_squares(canvas: Canvas, true: Floats, _: int) -> None:
    """Lit, steady, none nearer to the panel than 90 px."""
    for x, y in itertools.product(range(40, 640, 62), range(40, 480, 66)):
        if math.dist((x, y), true.mean(axis=0)) > 90:
            canvas.lamp(square(x, y, 24, x % 30), 0.5)


def lamp_after_four(canvas: Canvas, true: Floats, n: int) -> None:
    """In the panel's place, as bright, built as it is."""
    if n >= 4:
        canvas.lamp(true, 0.4, profile=diffuser)


def lamps(canvas: Canvas, _: Floats, n: int) -> None:
    """A square one, a round one, one with panes, and a lit word."""
    panes = np.random.default_rng(2).uniform(0.3, 1.0, (4, 4))
    letters = np.zeros((480, 640), np.uint8)
    cv2.putText(letters, "EXIT", (60, 420), cv2.FONT_HERSHEY_SIMPLEX, 2, 255, 8)
    canvas.lamp(square(120, 120, 100, 11 * n), 0.4)
    canvas.disc(320, 120, 45)
    canvas.lamp(
        square(500, 140, 110, 7), 0.4, profile=lambda u, v: panes[(4 * v).astype(int) % 4, (4 * u).astype(int) % 4]
    )
    canvas.light = np.maximum(canvas.light, 0.6 / 255 * cv2.GaussianBlur(letters.astype(float), (0, 0), 0.7))


def dead(row: int, column: int) -> Floats:
    gains = np.ones((4, 4))
    gains[row, column] = 0.0
    return gains


def columns(first: int, last: int) -> Condition:
    """Lights only these of a panel: turned away by however much, that is no panel."""
    lit = np.zeros((4, 4))
    lit[:, first : last + 1] = 1.0
    return Condition(cells=lambda _: word(7), gains=lit, turned_on_deg=9.0, turn_deg=0.0)


def halves(n: int) -> Bits:
    """One cell of each class side by side: as a 4 × 4 panel that is a cell off word 37, but no fault here."""
    return np.rot90(np.repeat([False, True], 8).reshape(4, 4), n)


OBLIQUE_60, OBLIQUE_75 = Condition(yaw_deg=60, turn_deg=0.0), Condition(yaw_deg=75, turn_deg=0.0)

CONDITIONS = {
    "nearly upright": Condition(ids=(7, 42), turn_deg=3.0),
    "turned by 40°": Condition(ids=(7, 42), turn_deg=40.0),
    "turned by 8°": Condition(turn_deg=8.0),
    "evenly lit": Condition(profile=flat, turn_deg=33.0),
    "cells of one size": Condition(profile=one_size, turn_deg=33.0),
    "bare LEDs": Condition(profile=bare, turn_deg=33.0),
    "seen from 60° aside": OBLIQUE_60,
    "… rolled by 45°": replace(OBLIQUE_60, turn_deg=45.0),
    "seen from 75° aside": OBLIQUE_75,
    "… rolled by 45° too": replace(OBLIQUE_75, turn_deg=45.0),
    "… rolled by 90° too": replace(OBLIQUE_75, turn_deg=90.0),
    "behind a lens": Condition(lens=LENS, centre=(500.0, 370.0)),
    "near and far": Condition(ids=(42,), also=(7, 12, 23), behind=three_more, centre=(400.0, 350.0), turn_deg=30.0),
    "a dead cell at a corner": Condition(gains=dead(0, 3), turn_deg=28.0),
    "a dead cell along a side": Condition(gains=dead(3, 1), turn_deg=28.0),
    "a dead cell within": Condition(gains=dead(1, 2), turn_deg=28.0),
    "4 % hidden": Condition(before=hiding(0.04)),
    "8 % hidden": Condition(before=hiding(0.08)),
    "12 % hidden": Condition(before=hiding(0.12)),
    "4 % hidden, turned by 40°": Condition(before=hiding(0.04), turn_deg=40.0),
    "8 % hidden, turned by 40°": Condition(before=hiding(0.08), turn_deg=40.0),
    "12 % hidden, turned by 40°": Condition(before=hiding(0.12), turn_deg=40.0),
    "in a dim frame": Condition(behind=around(0.1)),
    "in a bright frame": Condition(behind=around(0.3)),
    "evenly lit, in a bright frame": Condition(profile=flat, behind=around(0.3)),
    "touched by sheets": Condition(behind=sheets, turn_deg=0.0),
    "dim, in a bright room": Condition(behind=bright_room, background=0.05, light=0.15, centre=(200.0, 240.0)),
    "bands steeper than said": Condition(steeper=1.6, turn_deg=25.0),
    "bands smoothed": Condition(smoothing_px=0.8, turn_deg=25.0),
    "bands steeper and smoothed": Condition(steeper=1.6, smoothing_px=0.8, turn_deg=25.0),
    "moving": Condition(step_px=5.0, centre=(250.0, 240.2), turn_deg=30.0),
    "moving, bare LEDs": Condition(step_px=5.0, centre=(250.0, 240.2), turn_deg=30.0, profile=bare),
    "among sixty steady squares": Condition(behind=sixty_squares),
    "replaced by a lamp after four frames": Condition(behind=lamp_after_four, gone_from=4),
    "two cells alone": Condition(cells=halves, light=0.3, profile=flat, turn_deg=20.0, turned_on_deg=5.0),
    "columns 0–1 alone": columns(0, 1),
    "columns 1–2 alone": columns(1, 2),
    "columns 0–2 alone": columns(0, 2),
    "lamps, a disc and a sign": Condition(behind=lamps, gone_from=0),
}


@cache
def frames(name: str, exposure_us: float, distance_m: float, count: int, stream: bool) -> tuple[Frame, ...]:
    """The pictures of a scenario, painted once for all that is asked of them."""
    return tuple(frame(CONDITIONS[name], exposure_us, distance_m, n, stream=stream) for n in range(count))
