"""A dictionary's words as classes of cells: what a panel shows for an ID, and how it looks when it is turned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Bits = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Dictionary:
    """Words of n × n cells. True blinks at `white_hz`, False at `black_hz`."""

    name: str
    words: Bits  # (IDs, n, n), upright, row 0 at the top, read-only

    @property
    def cells_per_side(self) -> int:
        return int(self.words.shape[1])

    def word(self, marker_id: int) -> Bits:
        """The (n, n) word of an ID, upright. Raises ValueError for an ID that the dictionary does not have."""
        if not 0 <= marker_id < len(self.words):
            raise ValueError(f"{self.name} has the IDs 0 to {len(self.words) - 1}, not {marker_id}")
        word: Bits = self.words[marker_id]
        return word

    def turned_words(self) -> Bits:
        """(IDs, 4, n, n): each word as it looks after 0, 1, 2, 3 quarter turns **clockwise** in the picture."""
        return np.stack([np.rot90(self.words, -k, axes=(1, 2)) for k in range(4)], axis=1)

    def correctable_cells(self) -> int:
        """⌊(d − 1)/2⌋ for the smallest distance d between two words, however they are turned."""
        flat = self.turned_words().reshape(len(self.words), 4, -1).astype(np.int32)
        upright, turned = flat[:, 0], flat.reshape(-1, flat.shape[-1])
        distance = upright @ (1 - turned).T + (1 - upright) @ turned.T
        own = np.arange(len(upright))
        distance[own, 4 * own] = distance.max()  # each word to itself
        return int(distance.min() - 1) // 2


def corners_of_turned(quad_corners: NDArray[np.float64], quarter_turns: int) -> NDArray[np.float64]:
    """The marker's own corner order (top left first), of a quad that shows its word turned clockwise.

    `quad_corners` (4, 2) runs clockwise in the picture. After one quarter turn clockwise, the marker's top left
    corner is where the picture's top right one is.
    """
    return np.roll(quad_corners, -quarter_turns, axis=0)
