"""Corners of squares whose cells blink so deeply that dark bands stripe them: where a lattice explains most light.

The rim of such a square may be dark, all along a side; so no edge is looked for. A side may have been found a band too
far inside, or along a band's edge: several places of each are tried, with the bands' phases and each cell's class as
they explain the light best (`band_light`). From there the panel's picture is fitted as a whole (`panel_fit`), and from
where a track leads that is all there is to do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from ledpi.decode.corners.approach import NOT_STRAIGHT
from ledpi.decode.corners.edges import NOT_WHOLE
from ledpi.decode.corners.sides import OPPOSITE, Points, Sides, areas, as_points
from ledpi.decode.finding.find import Candidate
from ledpi.decode.striped.band_light import BandLight, Bands
from ledpi.decode.striped.fitted_square import MARGIN_PX, NO_BANDS, STEADY, bands_at, side_of, square_near
from ledpi.decode.striped.inner_walls import cells_meet
from ledpi.decode.striped.lattice import fine_lattice, rough_lattice
from ledpi.decode.striped.light_window import Window, have_contrast
from ledpi.decode.striped.panel_fit import Fit, fitted
from ledpi.decode.striped.part_of_panel import PART, is_part
from ledpi.decode.striped.steady import is_steady
from ledpi.records import Floats, Frame, Intrinsics, PanelSpec, Quad, Rejected, SeenBands

BENT = (NOT_STRAIGHT, NOT_WHOLE)  # what edges may say of a panel whose bands are deep

SAME_CENTRE, SAME_SIZE = 0.25, 1.5  # of the side: what is nearer, and about as large, is the same thing
REACH = 0.45  # of the side, around it
BLINKS = 0.95  # where they explain so much, it need not be asked whether steady cells explain more
OUTWARD = np.linspace(0, 1, 5)  # places of a side that are tried, in dark bands
MOST_STARTS, APART = 4, 0.08  # of the side: what is nearer than that leads to the same
MOST_LOOKS = 40  # among the best of those that are tried
CLIMBS, CLIMBS_OF_A_KIND = (0.15, 0.07, 0.03), 3  # steps, as shares of the side, and how many of each
# Of a climb, (20, 4) each: sides further out or in, or turned by twice that over their length; two opposite ones alike.
_OUT_AND_IN = np.concatenate([np.eye(4), -np.eye(4)])
_ALONG = np.array([[1.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, -1.0]])
MIDDLES = np.concatenate([_OUT_AND_IN, np.zeros((8, 4)), _ALONG, -_ALONG])
SLOPES = np.concatenate([np.zeros((8, 4)), 2 * _OUT_AND_IN, np.zeros((4, 4))])
MOST_FITS = 3  # of where climbs lead, the best
MOST_TRIED = 2  # of first fits, by all points: the best may be a part of a panel, or come to nothing
LOOK_ROUNDS = 3  # of a first fit, by few points
# After it: of the light's squares, that a panel's picture explains, and the corners' deviation, as a share of the side.
# What is clear then need not be sought elsewhere; CLEAR: of what the bands bring, that is not explained.
MIN_ROUGHLY, CLEAR = 0.7, 0.12
MAX_ROUGH_SIGMA, CLEAR_SIGMA = 0.03, 0.005


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
    contrasty = have_contrast(frame, as_points(np.array([c.corners for c in candidates])), cells, specs)
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
            smaller, larger = sorted((candidate.side_px, thing[0].side_px))
            away = math.dist(candidate.centre_px, thing[0].centre_px)
            if larger < SAME_SIZE * smaller and away < SAME_CENTRE * larger:
                thing.append(candidate)
                break
        else:
            things.append([candidate])
    return [np.array([candidate.corners for candidate in thing]) for thing in things]


def _is_same(a: Floats, b: Floats) -> bool:
    side = math.sqrt(max(abs(float(areas(as_points(corners)))) for corners in (a, b)))
    return math.dist(a.mean(axis=0), b.mean(axis=0)) < SAME_CENTRE * side


def striped_near(
    frame: Frame, near: Sequence[Floats], cells: int, specs: Sequence[PanelSpec], intrinsics: Intrinsics | None = None
) -> list[Quad | Rejected]:
    """The square near each of these corners (4, 2), off by a few percent of the side; or why there is none."""
    return [square_near(frame, as_points(corners), cells, specs, intrinsics) for corners in near]


def fitted_squares(
    frame: Frame,
    squares: Sequence[tuple[Floats, Quad | Rejected]],
    cells: int,
    specs: Sequence[PanelSpec],
    bent_rows: float,
    intrinsics: Intrinsics | None = None,
) -> list[tuple[Floats, Quad | Rejected]]:
    """The same squares, beside where they were sought (4, 2), by the panel's whole picture where that fits; no parts.

    Bands that are `bent_rows` high have led edges astray, or had them refused. Of a square that seems hidden in
    part the more exact corners are believed: where something does hide it, its picture fits badly.
    """
    results = []
    for sought, square in squares:
        fit: Quad | Rejected = square
        if isinstance(square, Quad):
            fit = square_near(frame, as_points(square.corners_px), cells, specs, intrinsics)
            if square.seen_px is not None and isinstance(fit, Quad) and fit.corner_sigma_px > square.corner_sigma_px:
                fit = square
        elif square in BENT:
            fit = striped_square(frame, sought[None], cells, specs, bent_rows, intrinsics)
        found = fit if isinstance(fit, Quad) else square
        results.append((sought, _if_cells_meet(frame, found, cells, specs) if isinstance(found, Quad) else found))
    return results


def _if_cells_meet(frame: Frame, square: Quad, cells: int, specs: Sequence[PanelSpec]) -> Quad | Rejected:
    """The square, if its cells meet where it says: by the bands of its fit, or else those that explain most of it."""
    at, seen = as_points(square.corners_px), square.bands
    window = Window.around(frame, at[None], MARGIN_PX)
    if seen is None:
        bands = bands_at(window, at, cells, specs)
        if isinstance(bands, Rejected):
            return square
        black, white = bands.phases.tolist()
        seen = SeenBands(spec=bands.spec, white=bands.white, phases=(black, white), shape=None)
    return square if cells_meet(window, square.corners_px, seen, cells) else PART


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
    seen = [bands_at(window, at, cells, specs) for at in near]
    likely_first = sorted(range(len(near)), key=lambda k: -_explained(seen[k]))
    near, seen = near[likely_first], [seen[k] for k in likely_first]
    bands = seen[0]
    if isinstance(bands, Rejected):
        return NO_BANDS
    steady = window.waves_of(bands.spec).least > STEADY
    if not steady and bands.explained < BLINKS and all(map(partial(_is_steady, window, cells), near, seen)):
        return NO_BANDS
    first = _look(window, near[0], bands, cells, intrinsics)
    if isinstance(first, Fit) and _is_clear(first, window.waves_of(bands.spec).share):
        square = _whole(window, first.corners, cells, specs, intrinsics)
        if isinstance(square, Quad):
            return square
    light = BandLight.of(window, bands, cells, focal_px)
    likely = window.in_picture(_likely(light, window.within(near), stripe_rows / window.shrink, climbing=steady))
    looks = (_look(window, at, bands_at(window, at, cells, specs), cells, intrinsics) for at in likely)
    found = np.array([fit.corners for fit in (first, *looks) if isinstance(fit, Fit)])
    result: Quad | Rejected = NO_BANDS
    worth = light.explains(window.within(found), fine_lattice(cells)) if len(found) else np.empty(0)
    for best in np.argsort(-worth)[:MOST_TRIED]:
        result = _whole(window, found[best], cells, specs, intrinsics)
        if isinstance(result, Quad):
            break
    return result


def _whole(
    window: Window, near: Points, cells: int, specs: Sequence[PanelSpec], intrinsics: Intrinsics | None
) -> Quad | Rejected:
    """The square near corners (4,), if it is not a part of a panel."""
    square = square_near(window.frame, near, cells, specs, intrinsics)
    if isinstance(square, Quad) and square.bands is not None and is_part(window, square, square.bands, cells):
        return PART
    return square


def _explained(bands: Bands | Rejected) -> float:
    return bands.explained if isinstance(bands, Bands) else 0.0


def _is_steady(window: Window, cells: int, near: Points, bands: Bands | Rejected) -> bool:
    return isinstance(bands, Rejected) or is_steady(window, window.within(near), cells, bands)


def _look(
    window: Window, near: Points, bands: Bands | Rejected, cells: int, intrinsics: Intrinsics | None
) -> Fit | Rejected:
    """A first fit, by few points; from corners (4,) that may be a tenth of the side off."""
    if isinstance(bands, Rejected):
        return bands
    fit = fitted(window, near, bands, cells, intrinsics, rounds=LOOK_ROUNDS, roughly=True)
    if fit is None or fit.explained <= MIN_ROUGHLY or not fit.sigma_px < MAX_ROUGH_SIGMA * side_of(fit.corners):
        return NO_BANDS
    return fit


def _is_clear(fit: Fit, share: float) -> bool:
    """Whether no other fit can be better. `share`: of all light's squares, that bands bring."""
    return fit.explained > 1 - CLEAR * share and fit.sigma_px < CLEAR_SIGMA * side_of(fit.corners)


def _likely(light: BandLight, near: Points, stripe: float, *, climbing: bool) -> Points:
    """(K, 4) of `near` (S, 4), and of the same with some of their sides further outside, what explains most near by.

    None of them as good as the same. What was found of a panel all of whose cells are dark in turn ends
    at dark bands; where some are steady it may end anywhere, and `climbing` leads on.
    """
    tried = np.concatenate([_other_sides(corners, first, stripe) for corners in near for first in (0, 1)])
    tried = tried[np.isfinite(tried).all(axis=1)]
    worth = light.explains(tried, rough_lattice(light.cells))
    starts = np.concatenate([near, tried[np.argsort(-worth)[:MOST_LOOKS]]])
    if not climbing:
        return _apart(starts, MOST_STARTS)[1:]  # the first of `near` has been looked at
    climbed = _climbed(light, _apart(starts, len(near) + MOST_STARTS))
    worth = light.explains(climbed, fine_lattice(light.cells))
    return _apart(climbed[np.argsort(-worth)], MOST_FITS)


def _apart(squares: Points, most: int) -> Points:
    """(K, 4) the first of squares (N, 4), and each later one that is not like one before."""
    unlike = np.abs(squares[:, None] - squares).max(axis=2) > APART * np.sqrt(np.abs(areas(squares)))[:, None]
    chosen: list[int] = []
    for k in range(len(squares)):
        if len(chosen) < most and unlike[k, chosen].all():
            chosen.append(k)
    apart: Points = squares[chosen]
    return apart


def _climbed(light: BandLight, starts: Points) -> Points:
    """(K, 4) whither steps lead from `starts` (K, 4) that move or turn a side, or move all, and explain more."""
    at, lattice = starts, rough_lattice(light.cells)
    own, ways = np.arange(len(starts)), len(MIDDLES)
    worth = light.explains(at, lattice)
    for step in CLIMBS:
        for _ in range(CLIMBS_OF_A_KIND):
            step_px = np.repeat(step * np.sqrt(np.abs(areas(at))), ways)[:, None]
            sides = Sides.of(np.repeat(at, ways, axis=0))
            further = sides.moved(step_px * np.tile(MIDDLES, (len(at), 1)), step_px * np.tile(SLOPES, (len(at), 1)))
            explained = light.explains(further, lattice).reshape(-1, ways)
            best = explained.argmax(axis=1)
            better = explained[own, best] > worth
            if not better.any():
                break
            at = np.where(better[:, None], further.reshape(-1, ways, 4)[own, best], at)
            worth = np.where(better, explained[own, best], worth)
    return at


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
