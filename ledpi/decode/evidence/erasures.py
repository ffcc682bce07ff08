"""Takes cells that give no light out of the evidence: dead ones, and those that are wholly occluded.

The light in such a cell comes from its neighbours, and has their bands. So it says nothing of the cell's class: in
terms of codes it is an erasure, not an error.
"""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Mask
from ledpi.decode.evidence.evidence import Evidence

# Of the cells' mean light: less is no cell's own. LEDs that differ by 15 % (a deviation) keep to more than twice that;
# across a gap comes 0.05 to 0.15 where cells are 7 px, and 0.3 where they are 3 px.
UNLIT = 1.0 / 3.0


def erase_cells(evidence: Evidence, unlit: Mask) -> Evidence:
    """The evidence without what it holds of some cells (cells,)."""
    if True not in unlit.tolist():
        return evidence
    size, cell = evidence.score.size, np.repeat(unlit, evidence.score.shape[1])
    information, score = evidence.information.reshape(size, size), evidence.score.reshape(size)
    ridge = 1e-9 * np.trace(information) / size + 1e-12
    own = information[np.ix_(cell, cell)] + ridge * np.eye(int(cell.sum()))
    taken = np.linalg.solve(own, np.column_stack([information[cell], score[cell]]))
    left = information - information[:, cell] @ taken[:, :-1]
    left[cell], left[:, cell] = 0.0, 0.0
    rest = np.where(cell, 0.0, score - information[:, cell] @ taken[:, -1])
    return evidence._replace(
        score=rest.reshape(evidence.score.shape), information=left.reshape(evidence.information.shape)
    )
