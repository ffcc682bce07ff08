"""Takes cells that give no light out of the evidence: dead ones, and those that something hides altogether.

What light there is in such a cell has come across from its neighbours, and shows their bands. So it may have bands of
any kind, and says nothing of its class: in the terms of codes an erasure, not an error.
"""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Mask, Singles
from ledpi.decode.cells import CellSamples
from ledpi.decode.evidence.evidence import Evidence

# Of the cells' mean light: less is no cell's own. LEDs that differ by 15 % (a deviation) keep to more than twice that;
# across a gap comes 0.05 to 0.15 where cells are 7 px, and 0.3 where they are 3 px.
UNLIT = 1.0 / 3.0


def unlit_cells(samples: CellSamples, shown: Singles | None = None) -> Mask:
    """(cells,) which of them give no light of their own.

    Where bands are deep a cell may be dark for being in them: `shown` (cells, points) is what they make of an even
    light.
    """
    light, valid = samples.light, samples.valid
    if shown is not None:  # by least squares: where a cell is to be dark, there is stray light
        shown = shown if valid is None else shown * valid
        level = (light * shown).sum(axis=1) / np.square(shown).sum(axis=1)
    else:
        level = light.sum(axis=1) if valid is None else light.sum(axis=1) / np.maximum(valid.sum(axis=1), 1)
    return np.asarray(level < UNLIT / len(level) * level.sum())


def without_unlit(evidence: Evidence, samples: CellSamples, shown: Singles | None = None) -> Evidence:
    """The evidence, with whatever bands fit best in cells that are unlit: of these it holds nothing then.

    `shown` as of `unlit_cells`.
    """
    unlit = unlit_cells(samples, shown)
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
