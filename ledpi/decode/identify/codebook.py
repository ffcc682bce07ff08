"""The codewords that a panel may show, in the form in which the evidence is compared with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ledpi.core.codewords import MOST_CORRECTED, Dictionary
from ledpi.core.records import Integers, Mask, PanelSpec, Singles

# Patterns that are no codeword differ in so many cells at least from each: what differs in fewer is meant for it.
NEAREST_PATTERN = MOST_CORRECTED + 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Codebook:
    """The codewords that a panel may show, turned all four ways, for one pair of frequencies."""

    ids: Integers  # (W,)
    quarter_turns: Integers  # (W,) clockwise
    white: Singles  # (W, cells) 1 where the class is white, 0 where black
    correctable: int  # cells that may be of the other class while it is still this codeword
    spec: PanelSpec

    @classmethod
    def build(cls, ids: list[int], dictionary: Dictionary, spec: PanelSpec) -> Codebook:
        """The codewords of those `ids` of a dictionary whose panels have this `spec`, but for ambiguous ones.

        Raises ValueError where there are none.
        """
        readable = set(dictionary.readable_ids(spec.phase))
        ids = [marker_id for marker_id in ids if marker_id in readable]
        if not ids:
            raise ValueError(dictionary.none_readable(spec.phase))
        codewords = dictionary.rotated_codewords()[ids].reshape(len(ids) * 4, -1)
        return cls(
            ids=np.repeat(np.asarray(ids, np.int64), 4),
            quarter_turns=np.tile(np.arange(4), len(ids)),
            white=codewords.astype(np.float32),
            correctable=min(MOST_CORRECTED, dictionary.correctable_cells(spec.phase)),
            spec=spec,
        )

    def correctable_beside(self, erased: Mask | None, codeword: int) -> int:
        """`correctable` where the `erased` (cells,) say nothing: ⌊(d − 1)/2⌋ of the other cells, if that is less.

        d: by how many of them this codeword differs from the one that is most like it there.
        """
        if erased is None:
            return self.correctable
        distinct = self.white[:, ~erased]
        apart = (distinct != distinct[codeword]).sum(axis=1)
        if self.spec.phase == "antiphase":
            apart = np.minimum(apart, distinct.shape[1] - apart)
        return max(0, min(self.correctable, int(np.delete(apart, codeword).min(initial=distinct.shape[1]) - 1) // 2))
