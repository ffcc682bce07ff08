"""Corners of squares whose cells blink so deeply that dark bands stripe them: where a lattice explains most light.

The rim of such a square may be dark, all along a side; so no edge is looked for. The whole lattice is fitted instead,
with the bands' phases and each cell's class as they explain the light best (`band_light`). A side may have been found
a band too far inside, or along a band's edge, so that several places of each are tried first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ledpi.decode.band_light import BandLight, Bands, Lattice, Window, fine_lattice, have_contrast, rough_lattice
from ledpi.decode.edges import checked
from ledpi.decode.find import Candidate
from ledpi.decode.sides import OPPOSITE, Points, Sides, areas, as_points, bends
from ledpi.records import Floats, Frame, Intrinsics, PanelSpec, Quad, Rejected

NO_BANDS = Rejected(stage="edges", reason="no_bands")

SAME_CENTRE = 0.25  # of the side: what is nearer is the same thing
REACH = 0.45  # of the side, around it
MIN_EXPLAINED = 0.6  # share of the light that a lattice's cells must explain
OUTWARD = np.linspace(0, 1, 5)  # places of a side that are tried, in dark bands
MOST_STARTS, FINALISTS = 5, 3
ROUGH_STEPS = 0.06, 0.03  # of the side, by which sides are moved
FIRST_STEPS = 0.03, 0.015
FINE_STEPS = 0.02, 0.01, 0.005
ROUNDS = 2  # with phases looked for anew
STRIPED_SIGMA = 0.004  # of the side: how far off corners' coordinates are then, measured at 0.4 to 2 m

# Each side inward, and turned.
_MOVES = np.concatenate([np.stack([np.eye(4), np.zeros((4, 4))]), np.stack([np.zeros((4, 4)), 2 * np.eye(4)])], axis=1)
_BOTH_WAYS = np.concatenate([_MOVES, -_MOVES], axis=1)  # (2, 16, 4)


def striped_squares(
    frame: Frame,
    candidates: Sequence[Candidate],
    cells: int,
    specs: Sequence[PanelSpec],
    stripe_rows: float,
    intrinsics: Intrinsics | None = None,
) -> list[tuple[Floats, Quad | Rejected]]:
    """The square of each thing that candidates are of, or why there is none, beside where it was sought (4, 2)."""
    results: list[tuple[Floats, Quad | Rejected]] = []
    found: list[Floats] = []
    if not candidates:
        return results
    contrasty = have_contrast(frame, as_points(np.array([c.corners for c in candidates])), cells)
    results += [(c.corners, NO_BANDS) for c, one in zip(candidates, contrasty, strict=True) if not one]
    for starts in _of_one_thing([c for c, one in zip(candidates, contrasty, strict=True) if one]):
        square = striped_square(frame, starts, cells, specs, stripe_rows, intrinsics)
        if isinstance(square, Quad):
            if any(_is_same(square.corners_px, other) for other in found):
                continue
            found.append(square.corners_px)
        results.append((starts[0], square))
    return results


def _of_one_thing(candidates: Sequence[Candidate]) -> list[Floats]:
    """(S, 4, 2) corners of those that have about the same centre."""
    things: list[list[Candidate]] = []
    for candidate in candidates:
        for thing in things:
            larger = max(candidate.side_px, thing[0].side_px)
            if math.dist(candidate.centre_px, thing[0].centre_px) < SAME_CENTRE * larger:
                thing.append(candidate)
                break
        else:
            things.append([candidate])
    return [np.array([candidate.corners for candidate in thing]) for thing in things]


def _is_same(a: Floats, b: Floats) -> bool:
    side = math.sqrt(max(abs(float(areas(as_points(corners)))) for corners in (a, b)))
    return math.dist(a.mean(axis=0), b.mean(axis=0)) < SAME_CENTRE * side


@np.errstate(divide="ignore", invalid="ignore", over="ignore")  # parallel sides cross nowhere: worth nothing
def striped_square(
    frame: Frame,
    starts: Floats,
    cells: int,
    specs: Sequence[PanelSpec],
    stripe_rows: float,
    intrinsics: Intrinsics | None = None,
) -> Quad | Rejected:
    """The square near rough corners (S, 4, 2), of which there may be several sets; or why there is none.

    `stripe_rows`: height of the longest dark band. `specs`: the frequencies that panels may have.
    """
    near = as_points(starts)
    focal_px = float(frame.pixels.shape[1] if intrinsics is None else intrinsics.fx)
    window = Window.around(frame, near, REACH * math.sqrt(np.abs(areas(near)).max()) + stripe_rows / 2)
    near = window.within(near)
    seen = [bands for at in near if (bands := Bands.at(window, at, cells, specs)) is not None]
    bands = max(seen, key=lambda one: one.explained, default=None)
    if bands is None or bands.explained < MIN_EXPLAINED:
        return NO_BANDS
    light = BandLight.of(window, bands, cells, focal_px)
    corners = _from_afar(light, near, stripe_rows / window.shrink)
    for _ in range(ROUNDS):
        bands = Bands.at(window, corners, cells, specs)
        if bands is None or bands.explained < MIN_EXPLAINED:
            return NO_BANDS
        light = BandLight.of(window, bands, cells, focal_px)
        corners = _climbed(light, corners[None], fine_lattice(cells), FINE_STEPS)[0][0]
    found = window.in_picture(corners)
    side, bend = math.sqrt(abs(areas(found))), bends(found[None], intrinsics)
    return checked(frame, found, STRIPED_SIGMA * side, float(np.abs(bend.imag).max()))


def _from_afar(light: BandLight, near: Points, stripe: float) -> Points:
    """(4,) corners that explain most, from any of `near` (S, 4) or with some of their sides further outside."""
    lattice = rough_lattice(light.cells)
    tried = np.concatenate([_other_sides(corners, first, stripe) for corners in near for first in (0, 1)])
    tried = tried[np.isfinite(tried).all(axis=1)]
    best = np.argsort(-light.explains(tried, lattice))[:MOST_STARTS]
    several, _ = _climbed(light, np.concatenate([near, tried[best]]), lattice, ROUGH_STEPS)
    several, lattice = np.concatenate([near, several]), fine_lattice(light.cells)
    best = np.argsort(-light.explains(several, lattice))[:FINALISTS]
    several, worth = _climbed(light, several[best], lattice, FIRST_STEPS)
    best_one: Points = several[worth.argmax()]
    return best_one


def _other_sides(corners: Points, first: int, stripe: float) -> Points:
    """(T, 4) corners (4,) with side `first` and the one opposite further out, either of them parallel to the other."""
    second = int(OPPOSITE[first])
    sides = Sides.of(corners[None])
    along = sides.along[0] / sides.length[0]
    level = 1 - np.abs(along.imag)
    # By how much each is turned when it is made parallel to the other, over its own length.
    opposite = -along[OPPOSITE] / along
    turn = (sides.length[0] * opposite.imag / opposite.real)[[first, second]]
    count = len(OUTWARD)
    middle, slope = np.zeros((3, count, count, 4)), np.zeros((3, count, count, 4))
    for way in range(3):
        reach = [level[first], level[second]]
        if way:
            side = (first, second)[way - 1]
            slope[way, ..., side] = turn[way - 1]
            reach[way - 1] = 1.0
        middle[way, ..., first] = -stripe * reach[0] * OUTWARD[:, None]
        middle[way, ..., second] = -stripe * reach[1] * OUTWARD
    moved: Points = sides.moved(middle.reshape(-1, 4), slope.reshape(-1, 4))
    return moved


def _climbed(light: BandLight, corners: Points, lattice: Lattice, steps: Sequence[float]) -> tuple[Points, Floats]:
    """Corners (S, 4) that explain more, and how much, each side moved and turned by about `steps` of the side."""
    worth = light.explains(corners, lattice)
    for step in steps:
        corners, worth = _one_step(light, corners, worth, lattice, step)
    return corners, worth


def _one_step(
    light: BandLight, corners: Points, worth: Floats, lattice: Lattice, step: float
) -> tuple[Points, Floats]:
    """By Newton's method along each of the eight ways in which sides move, all at once; or the best single one."""
    count, ways = len(corners), _MOVES.shape[1]
    px = (step * np.sqrt(np.abs(areas(corners))))[:, None, None]
    sides = Sides.of(np.repeat(corners, 2 * ways, axis=0))
    tried = sides.moved(*((px * moves).reshape(-1, 4) for moves in _BOTH_WAYS))
    tried_worth = light.explains(tried, lattice).reshape(count, 2, ways)
    more, less = tried_worth[:, 0], tried_worth[:, 1]
    bend = more + less - 2 * worth[:, None]
    newton = np.where(bend < 0, 0.5 * (less - more) / bend, np.sign(more - less))
    newton = np.where(np.isfinite(newton), newton, 0.0).clip(-1, 1)
    middle, slope = (px[..., 0] * (newton @ moves) for moves in _MOVES)
    single = tried.reshape(count, 2 * ways, 4)[np.arange(count), tried_worth.reshape(count, -1).argmax(axis=1)]
    here = Sides.of(corners)
    choice = np.stack([corners, here.moved(middle, slope), here.moved(0.5 * middle, 0.5 * slope), single], axis=1)
    its_worth = light.explains(choice[:, 1:].reshape(-1, 4), lattice).reshape(count, 3)
    its_worth = np.concatenate([worth[:, None], its_worth], axis=1)
    best = its_worth.argmax(axis=1)
    return choice[np.arange(count), best], its_worth[np.arange(count), best]
