"""A dictionary's codewords as classes of cells: what a panel shows for an ID, and how it looks when it is turned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ledpi.core.records import Phase

Bits = NDArray[np.bool_]

MOST_CORRECTED = 1  # cells that may be of the other class while a pattern still is a codeword

_TURNED = (np.arange(4)[:, None] + np.arange(4)) % 4  # which corner comes where, by quarter turns
_NUMBERS = (2 * _TURNED[:, :, None] + (0, 1)).reshape(4, 8)  # the same of x and y of each
_PRODUCTS = 8 * _NUMBERS[:, :, None] + _NUMBERS[:, None, :]  # and of their covariance, counted through


@dataclass(frozen=True, slots=True, kw_only=True)
class Dictionary:
    """Codewords of n × n cells. True blinks at `white_hz`, False at `black_hz`."""

    name: str
    codewords: Bits  # (IDs, n, n), upright, row 0 at the top, read-only

    @property
    def cells_per_side(self) -> int:
        """n of the n × n cells."""
        return int(self.codewords.shape[1])

    def codeword(self, marker_id: int) -> Bits:
        """The (n, n) codeword of an ID, upright. Raises ValueError for an ID that the dictionary does not have."""
        if not 0 <= marker_id < len(self.codewords):
            raise ValueError(f"{self.name} has the IDs 0 to {len(self.codewords) - 1}, not {marker_id}")
        codeword: Bits = self.codewords[marker_id]
        return codeword

    def rotated_codewords(self) -> Bits:
        """(IDs, 4, n, n): each codeword as it looks after 0, 1, 2, 3 quarter turns **clockwise** in the picture."""
        return np.stack([np.rot90(self.codewords, -k, axes=(1, 2)) for k in range(4)], axis=1)

    def distances(self, phase: Phase = "free") -> NDArray[np.int32]:
        """(IDs, 4·IDs) cells by which each codeword differs from every turned one; from itself unturned, as from none.

        Where classes blink in antiphase a codeword and its negative are one pattern, half a cycle apart: then it is the
        distance to the nearer of the two.
        """
        flat = self.rotated_codewords().reshape(len(self.codewords), 4, -1).astype(np.int32)
        upright, turned = flat[:, 0], flat.reshape(-1, flat.shape[-1])
        distance = upright @ (1 - turned).T + (1 - upright) @ turned.T
        if phase == "antiphase":
            distance = np.minimum(distance, flat.shape[-1] - distance)
        own = np.arange(len(upright))
        distance[own, 4 * own] = flat.shape[-1]
        return np.asarray(distance, np.int32)

    def readable_ids(self, phase: Phase = "free") -> tuple[int, ...]:
        """The IDs whose pattern is no other codeword's, nor their own rotated: in antiphase not all are."""
        if phase == "free":
            return tuple(range(len(self.codewords)))
        return tuple(np.flatnonzero(self.distances(phase).min(axis=1) > 0).tolist())

    def check_readable(self, marker_id: int, phase: Phase) -> None:
        """Raises ValueError for an ID that no panel of this phase can show, with those that it can."""
        self.codeword(marker_id)
        readable = self.readable_ids(phase)
        if marker_id not in readable:
            raise ValueError(
                f"{self.name}: ID {marker_id} is the negative of another codeword, or of its own when it is turned: in "
                f"antiphase they look alike; must be one of {format_ranges(readable)}"
            )

    def part_like_ids(self) -> tuple[int, ...]:
        """The IDs that a part of another panel can show where it is taken for a whole one.

        Where half of a panel's rows, say, are taken for all, rows are alike two by two. So look codewords of which no
        more cells differ from such a pattern than can be corrected.
        """
        side, most = self.cells_per_side, min(MOST_CORRECTED, self.correctable_cells())
        return tuple(i for i, codeword in enumerate(self.codewords) if _cells_off_repeating(codeword, side) <= most)

    def reflection_like_ids(self, phase: Phase = "free") -> tuple[int, ...]:
        """The IDs that a panel can show in a mirror: its own ID at a wrong place, or another panel's.

        Their mirror images look like a codeword in any rotation, but for as many cells as can be corrected. The
        relation holds both ways, so of a pair both are given.
        """
        known, mirrored = _as_numbers(self.rotated_codewords()), _as_numbers(self.codewords[:, :, ::-1])
        every_cell = _as_numbers(np.ones_like(self.codewords[:1]))
        if phase == "antiphase":
            known = np.concatenate([known, known ^ every_cell])
        off = [np.uint64(0)]
        if min(MOST_CORRECTED, self.correctable_cells(phase)):
            side = self.cells_per_side
            off += _as_numbers(np.eye(side * side, dtype=np.bool_).reshape(-1, side, side)).tolist()
        like = np.any([np.isin(mirrored ^ np.uint64(cell), known) for cell in off], axis=0)
        return tuple(np.flatnonzero(like).tolist())

    def none_readable(self, phase: Phase) -> str:
        """Says why `readable_ids` has none."""
        return f"no ID of {self.name} can be distinguished from the others in {phase}; panels.phase must be free"

    def correctable_cells(self, phase: Phase = "free") -> int:
        """⌊(d − 1)/2⌋ for the smallest distance d between codewords that can be read, in any rotation."""
        distance = self.distances(phase)
        readable = distance.min(axis=1) > 0
        return int(distance[readable].min(initial=distance.shape[1]) - 1) // 2


def _as_numbers(codewords: Bits) -> NDArray[np.uint64]:
    """(…, n, n) as one number each (n ≤ 8), by which they can be compared and looked up."""
    flat = codewords.reshape(-1, codewords.shape[-1] ** 2)
    padded = np.pad(flat, ((0, 0), (0, 64 - flat.shape[1])))
    return np.packbits(padded, axis=1).view(np.uint64).ravel()


def _cells_off_repeating(codeword: Bits, side: int) -> int:
    """By how many cells a codeword (n, n) differs from a pattern whose rows, or columns, are alike by two or more."""
    least = side * side
    for times in (n for n in range(2, side + 1) if side % n == 0):
        for lines in (codeword, codeword.T):
            white = lines.reshape(side // times, times, side).sum(axis=1)
            least = min(least, int(np.minimum(white, times - white).sum()))
    return least


def format_ranges(numbers: Sequence[int]) -> str:
    """Rising numbers, as in 0 to 3, 5, 7 to 9."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{run[0]} to {run[-1]}" if len(run) > 1 else str(run[0]) for run in runs) or "none"


def corners_of_turned(quad_corners: NDArray[np.float64], quarter_turns: int) -> NDArray[np.float64]:
    """The marker's own corner order (top left first), of a quad that shows its codeword turned clockwise.

    `quad_corners` (4, 2) runs clockwise in the picture. After one quarter turn clockwise, the marker's top left
    corner is where the picture's top right one is.
    """
    turned: NDArray[np.float64] = quad_corners.take(_TURNED[quarter_turns % 4], axis=0)
    return turned


def covariance_of_turned(quad_covariance: NDArray[np.float64], quarter_turns: int) -> NDArray[np.float64]:
    """(8, 8) of the corners' x and y, in the marker's own order, as `corners_of_turned` has it."""
    turned: NDArray[np.float64] = quad_covariance.take(_PRODUCTS[quarter_turns % 4])
    return turned
