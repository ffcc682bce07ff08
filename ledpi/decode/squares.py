"""The lit squares of a picture: near where they are expected, or anywhere in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ledpi.decode.cells import MIN_CELL_PX
from ledpi.decode.corners.approach import approach_quads
from ledpi.decode.corners.edges import prepare, refine_quads
from ledpi.decode.corners.inner_square import by_inner_lines, is_aside, is_near, is_same
from ledpi.decode.corners.spot_centres import by_spot_centres, is_part_of
from ledpi.decode.finding.find import Candidate, Finder
from ledpi.decode.striped.find_striped import MIN_STRIPED_CELL_PX, StripedFinder
from ledpi.decode.striped.fitted_square import NO_BANDS
from ledpi.decode.striped.striped import fitted_squares, striped_near, striped_squares
from ledpi.records import CameraInfo, Floats, Frame, Intrinsics, PanelSpec, Quad, Rejected, ToldBy


class Squares:
    """Of panels of `cells` × `cells` in the frames of one camera. Keeps the pictures that it works on.

    What is expected to be told by something else than its sides is said.
    """

    def __init__(
        self, camera: CameraInfo, cells: int, specs: tuple[PanelSpec, ...], intrinsics: Intrinsics | None
    ) -> None:
        self._cells, self._specs, self._intrinsics, self._rows = cells, specs, intrinsics, camera.height
        self._finder = Finder(camera.width, camera.height, cells * MIN_CELL_PX, cells)
        self._striped_finder = StripedFinder(camera.width, camera.height, specs, cells * MIN_STRIPED_CELL_PX)

    def prepare(self) -> None:
        """Makes what the first frames would else wait for."""
        prepare(self._cells, self._cells * MIN_CELL_PX, self._rows)

    def near(self, frame: Frame, expected: Sequence[tuple[Floats, ToldBy]]) -> list[Quad | Rejected]:
        """The square near each of these corners (4, 2), or why there is none; with what told it before."""
        squares = [at for at, told_by in expected if told_by != "spots"]
        refined = iter([quad for _, quad in self._unbent(frame, squares, self._refined(frame, squares))])
        return [
            by_spot_centres(frame, at, self._cells, self._intrinsics)
            if told_by == "spots"
            else self._by_sides_or_lines(frame, at, next(refined), told_by)
            for at, told_by in expected
        ]

    def _by_sides_or_lines(
        self, frame: Frame, at: Floats, by_sides: Quad | Rejected, told_by: ToldBy
    ) -> Quad | Rejected:
        """By its sides where they are to be believed, else by its inner lines, which takes longer."""
        if isinstance(by_sides, Quad) and (told_by == "sides" or is_near(by_sides, at, self._cells)):
            return by_sides
        if self._is_striped(frame):
            return by_sides
        within = by_inner_lines(frame, at, self._cells, self._intrinsics)
        return by_sides if isinstance(within, Rejected) else within

    def _is_striped(self, frame: Frame) -> bool:
        """Whether bands are so deep that they look like lines, and cut those that there are."""
        return bool(self._striped_finder.stripe_rows(frame))

    def by_lines(self, frame: Frame, known: Sequence[Quad], *, far: bool) -> list[Quad]:
        """Panels whose sides may not show, by the lines within them; of the frame that was searched last.

        But for those that are `known`, and parts of these. `far`: also those of few pixels.
        """
        found: list[Quad] = []
        if self._is_striped(frame):
            return found
        for at in self._finder.find_crossings(frame, far=far):
            quad = by_inner_lines(frame, at, self._cells, self._intrinsics)
            if isinstance(quad, Rejected) or any(is_same(quad, other, self._cells) for other in (*known, *found)):
                continue
            if not any(self._is_whole(frame, other) for other in known if is_aside(quad, other, self._cells)):
                found.append(quad)
        return found

    def _is_whole(self, frame: Frame, known: Quad) -> bool:
        """Whether the cells of a square meet where it says: then it is a panel's, and none that lies aside."""
        told = by_inner_lines(frame, known.corners_px, self._cells, self._intrinsics)
        return isinstance(told, Quad) and is_near(told, known.corners_px, self._cells)

    def candidates(self, frame: Frame) -> tuple[list[Candidate], list[Rejected]]:
        """What may be a panel, and what was dropped; where bands cut panels into pieces, what blinks."""
        if not self._striped_finder.stripe_rows(frame):
            return self._finder.find(frame)
        found, dropped = self._striped_finder.find(frame)
        if not self._striped_finder.is_cut(frame):  # then it may also be seen whole
            whole, dropped_too = self._finder.find(self._striped_finder.bridged(frame))
            found, dropped = found + whole, dropped + dropped_too
            blinks = self._striped_finder.blinks(frame, found, self._cells)
            dropped += [NO_BANDS] * blinks.count(False)
            found = [candidate for candidate, one in zip(found, blinks, strict=True) if one]
        return found, dropped

    def candidates_again(self, frame: Frame) -> tuple[list[Candidate], list[Rejected]]:
        """Of the same frame, where `candidates` have led to nothing: what only comes to light by other thresholds,
        or other sides."""
        if self._striped_finder.stripe_rows(frame):
            return self._striped_finder.find_again(frame), []
        return self._finder.find_again()

    def of(self, frame: Frame, candidates: list[Candidate]) -> list[tuple[Floats, Quad | Rejected]]:
        """The lit square of each candidate, or why there is none, beside the corners (4, 2) where it was sought."""
        stripe_rows = self._striped_finder.stripe_rows(frame)
        if stripe_rows:
            return striped_squares(frame, candidates, self._cells, self._specs, stripe_rows, self._intrinsics)
        squares = [candidate for candidate in candidates if not candidate.spots]
        near = approach_quads(
            frame,
            np.array([candidate.corners for candidate in squares]),
            np.array([candidate.tolerance_px for candidate in squares]),
        )
        refined = iter(self._refined(frame, [at for at in near if not isinstance(at, Rejected)]))
        quads = [at if isinstance(at, Rejected) else next(refined) for at in near]
        results = self._unbent(frame, [candidate.corners for candidate in squares], quads)
        for grid in (candidate.corners for candidate in candidates if candidate.spots):
            of_spots = by_spot_centres(frame, grid, self._cells, self._intrinsics)
            if isinstance(of_spots, Quad):
                by_sides = [quad for _, quad in results if isinstance(quad, Quad)]
                if any(is_near(quad, of_spots.corners_px, self._cells) for quad in by_sides):
                    continue  # lit up to its sides, which tell more exactly where it is
                # In place of what runs around its spots, or inside it.
                results = [(at, q) for at, q in results if isinstance(q, Rejected) or not is_part_of(q, of_spots)]
            results.append((grid, of_spots))
        return results

    def _refined(self, frame: Frame, near: list[Floats]) -> list[Quad | Rejected]:
        if self._striped_finder.stripe_rows(frame):
            return striped_near(frame, near, self._cells, self._specs, self._intrinsics)
        return refine_quads(frame, np.array(near), self._cells, self._intrinsics)

    def _unbent(
        self, frame: Frame, sought: list[Floats], squares: list[Quad | Rejected]
    ) -> list[tuple[Floats, Quad | Rejected]]:
        """Squares beside where they were sought; where bands bend edges, as the panel's whole picture has them."""
        results = list(zip(sought, squares, strict=True))
        bent_rows = self._striped_finder.bent_rows(frame)
        if not bent_rows:
            return results
        return fitted_squares(frame, results, self._cells, self._specs, bent_rows, self._intrinsics)
