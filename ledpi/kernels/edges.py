"""Sides of lit squares: how they are approached, and what they are (approach.c, edges.c and what it calls)."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import INTEGER, POINTER, address, doubles, function
from ledpi.kernels.light import PICTURE, picture
from ledpi.kernels.pose import lens_of
from ledpi.records import Floats, Frame, Intrinsics, Singles

MOST_PROFILES, MOST_CELLS = 64, 8  # as in kernels.h, lattice.h
# As in edges.c and approach.c.
WHOLE, PARTLY_HIDDEN, NO_EDGE, NOT_STRAIGHT, NOT_WHOLE, NOT_CONVEX, TOO_SMALL, AT_BORDER = range(8)
FILTER = 56  # numbers of a `Filter` of rim.h
# Numbers: the corners' x and y, those of what is seen, sigma_px, size_sigma_px, bend_px, rim_wall, cells_show.
REFINED = 21

_refine = function("ledpi_refine", *PICTURE, POINTER, POINTER, INTEGER, *(POINTER,) * 4, result=ctypes.c_bool)
_approach = function("ledpi_approach", *PICTURE, *(POINTER,) * 2, INTEGER, POINTER, INTEGER, *(POINTER,) * 4)


class _Filters(ctypes.Structure):
    """`Filters` of rim.h."""

    _fields_ = [
        ("filters", ctypes.c_void_p),
        *((name, ctypes.c_ssize_t) for name in ("pitches", "blurs", "first_pitch", "first_blur")),
        *((name, ctypes.c_double) for name in ("pitch_step", "blur_step", "least_pitch_px", "most_pitch_px")),
        *((name, ctypes.c_double) for name in ("least_blur_px", "most_blur_px", "usual_blur_px")),
    ]


class FilterTable:
    """Every filter of a rim there may be, by pitch and blur; those of a pitch are made together, and kept for good."""

    def __init__(
        self, pitch_steps: range, blur_steps: range, bounds: Sequence[float], made: Callable[[int], Floats]
    ) -> None:
        """`bounds`: as the last seven of `Filters` of rim.h. `made`: for a pitch step (B, N), a `Filter` of rim.h each.

        Their first number is 1.
        """
        self._pitch_steps, self._blurs, self._of_pitch = pitch_steps, len(blur_steps), made
        self._rows = np.zeros((len(pitch_steps), len(blur_steps), FILTER))
        counts = (len(pitch_steps), len(blur_steps), pitch_steps[0], blur_steps[0])
        self.structure = _Filters(address(self._rows), *counts, *bounds)
        self.at = ctypes.addressof(self.structure)

    def make_all(self) -> None:
        """In a fifth of a second."""
        for number in range(0, self._rows[..., 0].size, self._blurs):
            self.make(number)

    def make(self, number: int) -> None:
        """This one, and the others of its pitch."""
        rows = self._rows[number // self._blurs]
        if rows[0, 0]:
            return
        packed = self._of_pitch(self._pitch_steps[number // self._blurs])
        rows[:, 1:] = packed[:, 1:]
        rows[:, 0] = packed[:, 0]  # last, as another thread may look


class _Shares(ctypes.Structure):
    """`Shares` of kernels.h."""

    _fields_ = [("count", ctypes.c_ssize_t), ("share", ctypes.c_void_p), ("bend", ctypes.c_void_p)]


class _Explanations(ctypes.Structure):
    """`Explanations` of quads.h."""

    _fields_ = [("bases", ctypes.c_void_p), ("first", ctypes.c_void_p)]


class _Tables(ctypes.Structure):
    """`Tables` of quads.h."""

    _fields_ = [
        ("approaching", ctypes.c_void_p), ("refining", ctypes.c_void_p), ("filters", _Filters),
        ("profiles", _Shares), ("coarse", _Shares), ("templates", ctypes.c_void_p), ("cubics", ctypes.c_void_p),
        ("explanations", ctypes.c_void_p), ("first_blur", ctypes.c_ssize_t), ("blurs", ctypes.c_ssize_t),
        ("cells", ctypes.c_ssize_t),
    ]  # fmt: skip


class Tables:
    """What refining needs and is made beforehand, for panels of so many cells a side; kept for good."""

    def __init__(
        self,
        cells: int,
        filters: FilterTable,
        approaching: Floats,
        refining: Floats,
        profiles: tuple[Floats, Floats],
        coarse: tuple[Floats, Singles],
        cubics: Floats,
        blur_steps: range,
        explain: Callable[[int], tuple[Floats, NDArray[np.intp]]],
    ) -> None:
        """`approaching`, `refining`: constants, as in kernels.h and quads.h.

        `profiles`: shares (P,) of the way along a side, and their bends (2, P); `coarse`: shares and templates.
        `explain` makes the explanations for one of `blur_steps`: `bases` (columns, places) and where each begins.
        """
        assert len(profiles[0]) <= MOST_PROFILES
        self._filters, self._blur_steps, self._explain = filters, blur_steps, explain
        self._explanations = (_Explanations * len(blur_steps))()
        self._kept = [doubles(array) for array in (approaching, refining, *profiles, coarse[0], cubics)], coarse[1]
        *constants, share, bend, coarse_share, at_cubics = (address(array) for array in self._kept[0])
        self._made: dict[int, tuple[Floats, NDArray[np.intp]]] = {}
        structure = self._structure = _Tables(
            *constants, self._filters.structure, _Shares(len(profiles[0]), share, bend),
            _Shares(len(coarse[0]), coarse_share, None), address(coarse[1]), at_cubics,
            ctypes.addressof(self._explanations), blur_steps.start, len(blur_steps), cells,
        )  # fmt: skip
        self.at = ctypes.addressof(structure)

    def make(self, filter_number: int, explanations_number: int) -> None:
        """Of either what has this number, counted from 1; nothing for 0."""
        if filter_number:
            self._filters.make(filter_number - 1)
        if explanations_number:
            self.explain(self._blur_steps[explanations_number - 1])

    def explain(self, blur_step: int) -> None:
        """Makes the explanations for this step, unless they are."""
        number = self._blur_steps.index(blur_step)
        if number not in self._made:
            bases, first = self._made[number] = self._explain(blur_step)
            self._explanations[number].first = address(first)
            self._explanations[number].bases = address(bases)  # last, as another thread may look


def refine(frame: Frame, near: Floats, tables: Tables, intrinsics: Intrinsics | None) -> tuple[Floats, list[int]]:
    """(N, REFINED) of the squares near corners (N, 4, 2), and which of the outcomes above each is."""
    near, count = doubles(near), len(near)
    refined, outcomes, missing = np.empty((count, REFINED)), np.empty(count, np.int32), np.empty(2, np.intp)
    lens = lens_of(intrinsics) if intrinsics is not None and any(intrinsics.distortion) else None
    arguments = (
        *picture(frame), tables.at, None if lens is None else address(lens), count, address(near), address(refined),
        address(outcomes), address(missing),
    )  # fmt: skip
    while not _refine(*arguments):
        tables.make(*missing.tolist())
    return refined, outcomes.tolist()


def approach(
    frame: Frame,
    rough: Floats,
    tolerance_px: Floats,
    constants: Floats,
    share: Floats,
    templates: Singles,
) -> tuple[Floats, list[int]]:
    """As `approach_quads` of decode/corners/approach.py: corners (N, 4, 2); and 0, 1: no edge, 2: not straight."""
    rough, tolerance_px, count = doubles(rough), doubles(tolerance_px), len(rough)
    corners, outcomes = np.empty((count, 4, 2)), np.empty(count, np.int32)
    _approach(
        *picture(frame), address(constants), address(share), len(share), address(templates), count, address(rough),
        address(tolerance_px), address(corners), address(outcomes),
    )  # fmt: skip
    return corners, outcomes.tolist()
