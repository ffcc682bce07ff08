"""The words that a panel may show, as reading compares them with what is seen."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from ledpi.decode.cells import INSET
from ledpi.decode.identify.words import MOST_CORRECTED
from ledpi.markers import Dictionary
from ledpi.records import Floats, Integers, Mask, PanelSpec, Singles

# Patterns that are no word differ in so many cells at least from each: what differs in fewer is meant for it.
NEAREST_PATTERN = MOST_CORRECTED + 1
MOST_OF_PART = 0.5  # of a panel's cells: what shows more of them is a panel with a hidden side, which its walls tell


class Stretched(NamedTuple):
    """Parts of panels where each is taken for a whole one."""

    white: Singles  # (N, cells) by how much each cell is white
    cells: tuple[tuple[int, int], ...]  # N times: how many cells there are, across and down


@dataclass(frozen=True, slots=True, kw_only=True)
class Codebook:
    """The words that a panel may show, turned all four ways, for one pair of frequencies."""

    ids: Integers  # (W,)
    quarter_turns: Integers  # (W,) clockwise
    white: Singles  # (W, cells) 1 where the class is white, 0 where black
    correctable: int  # cells that may be of the other class while it is still this word: one, if it can be corrected
    spec: PanelSpec

    @classmethod
    def build(cls, ids: list[int], dictionary: Dictionary, spec: PanelSpec) -> Codebook:
        """The words of those `ids` of a dictionary whose panels have this `spec`, but for those that cannot be told.

        Raises ValueError where there are none.
        """
        readable = set(dictionary.readable_ids(spec.phase))
        ids = [marker_id for marker_id in ids if marker_id in readable]
        if not ids:
            raise ValueError(dictionary.none_readable(spec.phase))
        words = dictionary.turned_words()[ids].reshape(len(ids) * 4, -1)
        return cls(
            ids=np.repeat(np.asarray(ids, np.int64), 4),
            quarter_turns=np.tile(np.arange(4), len(ids)),
            white=words.astype(np.float32),
            correctable=min(MOST_CORRECTED, dictionary.correctable_cells(spec.phase)),
            spec=spec,
        )

    def nearest(self, white: Mask, most: int, told: Mask | None = None) -> Codebook:
        """Of those words that are most like a pattern (cells,), in the cells that are `told`, the nearest first."""
        differ = np.count_nonzero(((self.white > 0) != white) & (True if told is None else told), axis=1)
        rows = np.argsort(differ, kind="stable")[:most]
        return replace(self, ids=self.ids[rows], quarter_turns=self.quarter_turns[rows], white=self.white[rows])

    def is_coarse(self, white: Mask) -> bool:
        """Whether (cells,) is what a part of a panel looks like where it is taken for a whole one."""
        return repeats(white) or bool((coarse_patterns(math.isqrt(len(white))) == white).all(axis=1).any())

    def coarse_beside(self, word: int) -> Singles:
        """(N, cells) the coarse patterns that would be taken for this word, as no more cells differ than are corrected.

        The word itself is none of them.
        """
        return _coarse_beside(self.white[word].tobytes(), self.correctable)

    def stretched_beside(self, word: int) -> Stretched:
        """Parts of a panel, half of it or less, that would be taken for this word; they may be exactly like it.

        Their cells are larger than those that they are taken for, so that some of these may lie on two of them.
        """
        return _stretched_beside(self.white[word].tobytes(), self.correctable)

    def correctable_beside(self, silent: Mask | None, word: int) -> int:
        """`correctable` where the `silent` (cells,) say nothing: ⌊(d − 1)/2⌋ of the other cells, if that is less.

        d: by how many of them this word differs from the one that is most like it there.
        """
        if silent is None:
            return self.correctable
        told = self.white[:, ~silent]
        apart = (told != told[word]).sum(axis=1)
        if self.spec.phase == "antiphase":
            apart = np.minimum(apart, told.shape[1] - apart)
        return max(0, min(self.correctable, int(np.delete(apart, word).min(initial=told.shape[1]) - 1) // 2))


@cache
def coarse_patterns(side: int) -> Singles:
    """(N, cells) what up to four cells of a panel nearby look like where they are taken for a whole one.

    Two strips of rows by two of columns, each of the four parts of one class. So do two lamps beside each other, too.
    """
    ends = np.arange(side) < np.arange(1, side)[:, None]  # (side − 1, side) the first so many rows
    parts = np.stack(np.meshgrid(*[[0, 1]] * 4), axis=-1).reshape(-1, 2, 2)
    patterns = [part[rows.astype(int)][:, columns.astype(int)] for part in parts for rows in ends for columns in ends]
    return np.unique(np.reshape(patterns, (-1, side * side)), axis=0).astype(np.float32)


@lru_cache(maxsize=1024)  # each panel that is read asks for its word's
def _coarse_beside(word: bytes, correctable: int) -> Singles:
    """`Codebook.coarse_beside` of a word (cells,), given as its numbers' bytes."""
    pattern = np.frombuffer(word, np.float32)
    coarse = coarse_patterns(math.isqrt(len(pattern)))
    differ = np.count_nonzero(coarse != pattern, axis=1)
    return np.asarray(coarse[(differ > 0) & (differ <= correctable)])


@lru_cache(maxsize=1024)
def _stretched_beside(word: bytes, correctable: int) -> Stretched:
    """`Codebook.stretched_beside` of a word (cells,), given as its numbers' bytes."""
    pattern = np.frombuffer(word, np.float32)
    side = math.isqrt(len(pattern))
    found: dict[bytes, tuple[int, int]] = {}
    for of_rows, of_columns in product([_shares_of(side, few) for few in range(1, side + 1)], repeat=2):
        rows, columns = of_rows.shape[1], of_columns.shape[1]
        if rows * columns > MOST_OF_PART * len(pattern):
            continue
        # (cells, rows · columns) in which of the part's cells each of the panel's is, and in which it is most.
        share = np.kron(of_rows, of_columns)
        most = np.kron(np.eye(rows)[of_rows.argmax(axis=1)], np.eye(columns)[of_columns.argmax(axis=1)])
        part = (most.T @ (pattern - 0.5) > 0).astype(float)
        for flips in range(correctable + 1):
            for flipped in combinations(range(rows * columns), flips):
                other = part.copy()
                other[list(flipped)] = 1.0 - other[list(flipped)]
                mixed = share @ other
                if np.count_nonzero((mixed > 0.5) != (pattern > 0.5)) <= correctable:
                    found.setdefault(mixed.astype(np.float32).tobytes(), (columns, rows))
    white = np.array([np.frombuffer(mixed, np.float32) for mixed in found]).reshape(-1, len(pattern))
    return Stretched(white, tuple(found.values()))


def _shares_of(cells: int, few: int) -> Floats:
    """(cells, few) how much of each of so many cells in a row lies in each of a few, where its light is sampled."""
    first, borders = (np.arange(cells)[:, None] + INSET) / cells, np.arange(few + 1) / few
    width = (1.0 - 2.0 * INSET) / cells
    within = np.clip((borders - first) / width, 0.0, 1.0)
    return np.asarray(np.diff(within, axis=1))


def repeats(white: Mask) -> bool:
    """Whether the rows, or the columns, of a pattern (cells,) are alike two by two, or more of them.

    So looks a part of a panel, of half as many rows or columns, that is taken for a whole one. Word 17 of DICT_4X4_50
    is such a pattern, five others of it are one cell off.
    """
    side = math.isqrt(len(white))
    pattern = white.reshape(side, side)
    times = [n for n in range(2, side + 1) if side % n == 0]
    return any(bool((whole == np.repeat(whole[::n], n, axis=0)).all()) for n in times for whole in (pattern, pattern.T))
