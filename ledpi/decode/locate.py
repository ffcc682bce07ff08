"""Localises a panel from rough corners: by a fit of its whole picture."""

from __future__ import annotations

import math

import numpy as np

from ledpi.core.geometry import box, corners_apart, project_to_quad, quad_side
from ledpi.core.records import Floats, Frame, Intrinsics, Mask, PanelSpec, Quad, Rejected
from ledpi.decode.evidence.cells import MIN_CELL_PX, Lattice, Observation, sample_cells
from ledpi.decode.evidence.waves import FAINT_DEPTH, band_depth, dimmest
from ledpi.decode.finding.find import Glancer, Pyramid
from ledpi.decode.finding.glance import template
from ledpi.decode.following import MIN_EXPLAINED_FINELY, REACH, Follower
from ledpi.decode.model.fit import MISFIT, NO_BANDS, UNCERTAIN, FitOptions, Fitted, Fitter, side_covariance
from ledpi.decode.model.light import COARSE, FEWEST_PX, Window
from ledpi.decode.model.prior import BLUR, COMMON, OWN, RIM, SHAPE
from ledpi.decode.proposals import DEEP

TOO_SMALL = Rejected(stage="fit", reason="too_small")
NO_LIGHT = Rejected(stage="fit", reason="no_light")

# Of a cell that is looked at for bands: one is averaged down to this, or up to twice as much, so that its samples are
# about as far apart as pixels are. But over no more rows than a quarter of a wave: samples that are half a wave apart
# do not tell its cosine from its sine.
FEWEST_CELL_PX, MOST_CYCLES = 12.0, 0.25
MIN_EXPLAINED = 0.5  # of the light's squares: the first fit, from corners that are off, explains more than it leaves
# Where something seems to hide a side, what is left has a deviation of less than a fifth of the light's: a lattice that
# is a part of a cell off looks so, too.
MIN_EXPLAINED_HIDDEN = 0.96
MAX_SIGMA = 1.0 / 8.0  # of a cell: further off, slopes no longer tell what a shift does to a cell's light
LEAST_HIDDEN = MAX_SIGMA  # of a cell: a lattice that is off by less is not another one
# Where bands are not deep, a coarse fit is of as few pixels as its grid has lines: its blur is theirs. The next begins
# with a little more than a lens has, as what is blurred more is found from further off.
START_BLUR_PX = 1.2
# Of all cells' mean gain: where LEDs deviate by 15 %, a side of four cells of less is not the panel's own.
DARK_END = 0.5


class Locator:
    """Locates panels of `cells` × `cells` in the frames of one camera."""

    def __init__(
        self, cells: int, specs: tuple[PanelSpec, ...], intrinsics: Intrinsics | None, *, must_blink: bool = True
    ) -> None:
        """`must_blink`: what surely does not at these frequencies is none."""
        self._must_blink = must_blink
        self._cells, self._specs = cells, specs
        self._fitter = Fitter(cells, intrinsics)
        self.follower = Follower(self._fitter)
        self._intrinsics = intrinsics
        self._glancer = Glancer(cells, cells * MIN_CELL_PX, template(cells))

    @property
    def spent(self) -> int:
        """The cost of all fits so far: samples at which the model was compared with the picture."""
        return self._fitter.sampled

    def localise(self, frame: Frame, corners_px: Floats) -> Quad | Rejected:
        """The panel at a candidate (4, 2), or why there is none."""
        fit = self.begin(frame, corners_px)
        return fit if isinstance(fit, Rejected) else self.finish(frame, fit)

    def begin(self, frame: Frame, corners_px: Floats) -> Fitted | Rejected:
        """The best even fit at a candidate (4, 2), or why there is none."""
        fit = self._evenly(frame, corners_px, self._specs)
        if isinstance(fit, Rejected) or band_depth(frame, self._specs) > FAINT_DEPTH:
            return fit  # a dark band looks like a dark row
        return self._best_of(fit, self._placed(frame, fit))

    def finish(self, frame: Frame, fit: Fitted) -> Quad | Rejected:
        """The panel that an even fit has found, or why it is none."""
        return self._quad(self._best_placed(frame, self._finely(frame, fit)))

    def _evenly(self, frame: Frame, corners_px: Floats, specs: tuple[PanelSpec, ...]) -> Fitted | Rejected:
        """On a coarse grid, then on a fine one, with even cells, so that only corners move it."""
        depth = band_depth(frame, self._specs)
        deep, faint = depth > DEEP, depth <= FAINT_DEPTH
        coarse = FitOptions(
            rounds=8,
            tolerance=0.02,
            most_left=1.0 - MIN_EXPLAINED,
            most_sigma=math.inf if deep else MAX_SIGMA,  # of the few pixels that deep bands leave it knows too little
            coarse=True,
            even=True,
            banded=not faint,
            phasing=deep,
            must_blink=deep and self._must_blink,
        )
        fit = self._fitted(frame, corners_px, coarse, specs)
        if isinstance(fit, Rejected):
            return fit
        unknown = fit.unknown.copy()
        if not deep:
            unknown[BLUR] = math.log(START_BLUR_PX)
        evenly = FitOptions(
            rounds=6,
            tolerance=0.02,
            most_left=1.0 - MIN_EXPLAINED,
            most_sigma=MAX_SIGMA,
            even=True,
            faint=faint,
            banded=not faint,
            phasing=not faint,
            must_blink=not faint and self._must_blink,
        )
        return self._fitted(frame, fit.lattice_px, evenly, (fit.spec,), unknown)

    def _finely(self, frame: Frame, fit: Fitted) -> Fitted | Rejected:
        """From an even fit on, with all unknowns."""
        faint = band_depth(frame, self._specs) <= FAINT_DEPTH
        fine = FitOptions(rounds=10, reweightings=2, faint=faint, must_blink=self._must_blink)
        finely = self._fitted(frame, fit.lattice_px, fine, (fit.spec,), fit.unknown)
        if isinstance(finely, Rejected) or finely.settled or not finely.hidden.any():
            return finely  # what has a hidden side takes longer
        return self._fitted(frame, finely.lattice_px, fine, (fit.spec,), finely.unknown)

    def _best_placed(self, frame: Frame, fit: Fitted | Rejected) -> Fitted | Rejected:
        """The fit, or a better one from beside what seems hidden or dark: so looks a lattice that is off by as much."""
        placed = [] if isinstance(fit, Rejected) else self._placed(frame, fit)
        if not placed or isinstance(fit, Rejected):
            return fit
        other = self._finely(frame, self._best_of(placed[0], placed[1:]))
        return fit if isinstance(other, Rejected) else self._best_of(fit, [other])

    def _placed(self, frame: Frame, fit: Fitted) -> list[Fitted]:
        """Even fits beside what seems hidden or dark, until nothing of one seems so."""
        placed = []
        for at in self._likelier(frame, fit):
            even = self._evenly(frame, at, (fit.spec,))
            if isinstance(even, Rejected):
                continue
            placed.append(even)
            if self._is_better(even, fit) and not self._beside(even):
                break
        return placed

    def _best_of(self, fit: Fitted, others: list[Fitted]) -> Fitted:
        for other in others:
            if self._is_better(other, fit):
                fit = other
        return fit

    def _is_better(self, one: Fitted, other: Fitted) -> bool:
        """Tells whether one leaves less; and explains more, too, unless all of it is lit.

        More of the dark makes the share that is explained larger, and the residual smaller.
        """
        return one.residual < other.residual and (one.explained > other.explained or not self._beside(one))

    def _likelier(self, frame: Frame, fit: Fitted) -> list[Floats]:
        """Places beside a fit where a panel is likelier at a glance; all, where the template lacks their bands."""
        beside = self._beside(fit)
        if not beside or band_depth(frame, self._specs) > FAINT_DEPTH:
            return beside
        at = np.stack([fit.lattice_px, *beside])
        corners, evidence = self._glancer.look_at(Pyramid(*frame.pixels.shape).of(frame), at)
        off_px = corners_apart(corners[0].tolist(), fit.lattice_px.tolist())
        if not off_px < LEAST_HIDDEN * quad_side(fit.lattice_px.tolist()) / self._cells:
            return beside  # where it is, it is not likeliest
        return [at.copy() for at, likely in zip(corners[1:], evidence[1:] > evidence[0], strict=True) if likely]

    def _beside(self, fit: Fitted) -> list[Floats]:
        """Lattices (4, 2) that look like one with a hidden side or a dark row: moved by as much, or shorter by it."""
        n, is_dark = self._cells, self._dark_sides(fit)
        if fit.explained < MIN_EXPLAINED_FINELY or not (fit.hidden.max() >= LEAST_HIDDEN or is_dark.any()):
            return []
        above, right, below, left = (np.where(is_dark, 1.0, fit.hidden) / n).tolist()
        across, down = left - right, above - below
        moved, shorter = box(across, down, 1.0 + across, 1.0 + down), box(left, above, 1.0 - right, 1.0 - below)
        return [project_to_quad(fit.lattice_px, at) for at in (moved, shorter)]

    def _dark_sides(self, fit: Fitted) -> Mask:
        """(4,) whether the row of cells along each side, in the corners' order, is too dark to be the panel's own."""
        gain = fit.unknown[COMMON::OWN].reshape(self._cells, self._cells)
        ends = np.array([gain[0], gain[:, -1], gain[-1], gain[:, 0]])
        return np.asarray(ends.mean(axis=1) < DARK_END * gain.mean())

    def refine(self, frame: Frame, corners_px: Floats, known: Floats) -> Quad | Rejected:
        """The panel whose lattice is within a tenth of a cell or so of these corners (4, 2), or why there is none.

        `known`: the unknowns of its last fit, with its corners in the same order.
        """
        fine = FitOptions(rounds=6, reweightings=1, faint=band_depth(frame, self._specs) <= FAINT_DEPTH)
        fit = self._fitted(frame, corners_px, fine, self._specs, known)
        return self._quad(fit if known[RIM:SHAPE].max() > LEAST_HIDDEN else self._best_placed(frame, fit))

    def observe(
        self, frame: Frame, quad: Quad, *, sampled: bool = False, like: Lattice | None = None
    ) -> Observation | Rejected:
        """A panel that was fitted here, as this frame shows it. `sampled`: its cells, too.

        These on the lattice `like`, where the panel's size still suits it.
        """
        assert quad.lattice_px is not None, "it was fitted"
        assert quad.unknown is not None
        quickest_hz = max(hz for spec in self._specs for hz in spec.waves_hz)
        most_rows = MOST_CYCLES / (quickest_hz * abs(frame.row_time_us) * 1e-6)
        fewest_px = max(self._cells * FEWEST_CELL_PX, quad_side(quad.lattice_px.tolist()) / most_rows)
        window = Window.crop(frame, quad.lattice_px, REACH, fewest_px)
        if window is None:
            return NO_LIGHT
        samples = None
        if sampled:
            found = sample_cells(frame, quad, self._cells, self._intrinsics, like)
            if isinstance(found, Rejected):
                return found
            samples = found
        return Observation(frame.drop_picture(), window, quad.lattice_px, quad.unknown, samples)

    def _fitted(
        self,
        frame: Frame,
        corners_px: Floats,
        options: FitOptions,
        specs: tuple[PanelSpec, ...],
        known: Floats | None = None,
    ) -> Fitted | Rejected:
        """At the frequencies that explain most."""
        smallest_px = self._cells * MIN_CELL_PX
        if not quad_side(corners_px.tolist()) >= smallest_px:
            return TOO_SMALL
        fewest_px = FEWEST_PX if options.phasing or not options.coarse else self._cells * COARSE
        window = Window.crop(frame, corners_px, REACH, fewest_px)
        if window is None:
            return NO_LIGHT
        if options.coarse and options.phasing and window.dimmed > dimmest(frame, self._specs) * window.bright:
            return NO_BANDS
        fits = [self._fitter.fit(frame, window, corners_px, spec, options, known) for spec in specs]
        best = max(fits, key=lambda fit: fit.explained if isinstance(fit, Fitted) else -math.inf)
        if isinstance(best, Rejected):
            return best
        if not best.explained >= MIN_EXPLAINED:
            return MISFIT
        side_px = quad_side(best.corners_px.tolist())
        if not side_px >= smallest_px:
            return TOO_SMALL
        sigma_px = math.sqrt(float(np.trace(best.covariance_px2)) / 8.0)
        if options.coarse and options.phasing:
            return best  # in deep bands it sees few of the pixels: a finer grid may know more
        return best if sigma_px < MAX_SIGMA * side_px / self._cells else UNCERTAIN

    def _quad(self, fit: Fitted | Rejected) -> Quad | Rejected:
        if isinstance(fit, Rejected):
            return fit
        if not fit.explained >= (MIN_EXPLAINED_HIDDEN if fit.hidden.any() else MIN_EXPLAINED_FINELY):
            return MISFIT
        if self._dark_sides(fit).any():
            return MISFIT  # a lattice beside, though none of those tried fits better
        sides_px2 = side_covariance(fit.lattice_px, fit.unknown, fit.rim_variance, fit.hidden, self._cells)
        return Quad(
            corners_px=fit.corners_px,
            lattice_px=fit.lattice_px,
            covariance_px2=fit.covariance_px2 + fit.jackknife_px2 + sides_px2,
            blur_px=fit.blur_px,
            unknown=fit.unknown,
            residual=fit.residual,
            hidden=fit.hidden if fit.hidden.any() else None,
        )
