"""A panel's own picture, as fits had it: what the panel is followed by.

The light of another frame is this picture, moved, and slopes by all else that a fit has unknown. Most of that is
another in each frame: gains, blur, what is beside. How the panel is built is not: of that fits have a mean.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ledpi.core.records import Floats, Frame, Mask, PanelSpec, Quad
from ledpi.decode.evidence.waves import band_prior
from ledpi.decode.model.fit import Fitter, pitch_px_of
from ledpi.decode.model.light import Window, grid, waves
from ledpi.decode.model.panel import MOST_LINES, Picture
from ledpi.decode.model.prior import (
    ASIDE,
    BESIDE,
    BLUR_PX,
    COMMON,
    DEPTH,
    GAP,
    GLOW,
    OWN,
    PHASE,
    RIM,
    WAYS,
    prior,
)

# Walls, rims, a cell's profile: they are the picture's, and a frame by itself adds nothing.
LASTING = np.array([GAP, *range(RIM, PHASE), ASIDE, ASIDE + 1, DEPTH, GLOW])
FREE = 1e-6  # of a sample's information: what is known of a way in which the homography is wrong


def mean_of(fits: Sequence[Floats]) -> Floats:
    """The unknowns of the last of some fits, LASTING those of all."""
    unknown = fits[-1].copy()
    unknown[LASTING] = np.mean(fits, axis=0)[LASTING]
    return unknown


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PanelPicture:
    """On a grid that moves with the panel (panel_follow.c)."""

    spec: PanelSpec
    shares: Floats  # (cells, waves) of each wave in what cells show
    window: Window  # as it was taken from
    lattice_px: Floats  # (4, 2) where
    unknown: Floats  # the fit's
    picture: Picture
    variance: float  # of a sample within the panel
    independent: float  # samples there whose noise is
    residual: float  # as a fit's
    frames: int = 0  # that the panel was followed for

    @classmethod
    def taken(
        cls, fitter: Fitter, frame: Frame, window: Window, quad: Quad, spec: PanelSpec, shares: Floats, unknown: Floats
    ) -> PanelPicture | None:
        """The picture that these unknowns make of a panel, where it is; None where light tells too little."""
        assert quad.lattice_px is not None
        cells = math.isqrt(len(shares))
        pitch_px = pitch_px_of(quad.lattice_px, cells * window.shrink)
        lines = grid(cells, round(min(pitch_px), 1), coarse=False)
        if len(lines) > MOST_LINES:
            return None
        across, down = (round(max(1.0, min(len(lines) / cells, pitch)), 1) for pitch in pitch_px)
        given = prior(cells, (across, down), frame.exposure_us, even=False, faint=True)
        picture = _drawn(fitter, frame, window, quad, spec, shares, unknown, lines, given)
        variance = quad.residual / (window.bright - window.dark)
        held, off = _held(given, unknown, variance)
        passing = np.setdiff1d(np.arange(len(held)), LASTING)
        slopes = picture.arrays["slopes"][passing]
        try:
            solved = np.linalg.inv((slopes @ slopes.T).astype(np.float64) + np.diag(held[passing]))
        except np.linalg.LinAlgError:
            return None
        picture.arrays["inverse"][np.ix_(passing, passing)] = solved
        picture.arrays["pull"][:] = held * off
        ridge = variance / band_prior(frame, spec)[::2]
        picture.struct.ridge[0 : len(ridge)] = ridge.tolist()
        within = picture.arrays["weight"][_within(picture.arrays["along"], len(lines))] > 0
        return cls(
            spec=spec,
            shares=shares,
            window=window,
            lattice_px=quad.lattice_px,
            unknown=unknown,
            picture=picture,
            variance=variance,
            independent=float(within.sum()) / (4.0 * math.pi * BLUR_PX**2),  # white noise, blurred by as much
            residual=quad.residual,
        )


def _drawn(
    fitter: Fitter,
    frame: Frame,
    window: Window,
    quad: Quad,
    spec: PanelSpec,
    shares: Floats,
    unknown: Floats,
    lines: Floats,
    given: Floats,
) -> Picture:
    """The picture and its slopes on a grid of these lines."""
    assert quad.lattice_px is not None
    assert quad.covariance_px2 is not None
    count, width = COMMON + len(shares), -(-len(lines) // 8) * 8
    cells, size = math.isqrt(len(shares)), len(lines) * width
    along = np.pad(lines, (0, width - len(lines)), mode="edge") / cells
    picture = Picture(
        {
            "along": along.astype(np.float32),
            "weight": np.empty(size, np.float32),
            "light": np.empty(size, np.float32),
            "slopes": np.empty((count, size), np.float32),
            "shown": np.empty((shares.shape[1], size), np.float32),
            "inverse": np.zeros((count, count)),
            "pull": np.zeros(count),
        },
        lines=len(lines),
        width=width,
        unknowns=count,
        waves=shares.shape[1],
    )
    fitter.solver.put_picture(
        picture,
        shares,
        **fitter.view(window),
        cells=cells,
        waves=waves(spec, frame.exposure_us, frame.row_time_us, window.shrink),
        cycles_a_row=tuple(hz * frame.row_time_us * 1e-6 for hz in (spec.black_hz, spec.white_hz)),
        lines=len(lines),
        along=lines,
        prior=given,
        banded=True,
        corners=quad.lattice_px.reshape(-1).tolist(),
        unknown=unknown,
        covariance=quad.covariance_px2.reshape(-1).tolist(),
    )
    return picture


def _held(given: Floats, unknown: Floats, variance: float) -> tuple[Floats, Floats]:
    """(U,) what is known of unknowns beforehand, over a sample's; and how far they are off it."""
    mean, information = (np.concatenate([each[:COMMON], each[COMMON::OWN]]) for each in given)
    held, off = variance * information, mean - np.concatenate([unknown[:COMMON], unknown[COMMON::OWN]])
    held[:WAYS], off[:WAYS], off[PHASE:BESIDE] = FREE, 0.0, 0.0
    return held, off


def _within(along: Floats, lines: int) -> Mask:
    """(lines · width,) the samples within the panel, without those that fill up."""
    inside = (along > 0) & (along < 1)
    return np.outer(inside[:lines], inside & (np.arange(len(along)) < lines)).reshape(-1)
