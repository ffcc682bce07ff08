"""What a panel shows that is no word, if it is a word that was built, wired or configured otherwise.

For people who look why a panel is not read: it is a hint, never an ID.
"""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Floats
from ledpi.markers.codewords import Bits, Dictionary
from ledpi.markers.dictionaries import dictionary_names, load_dictionary

SURE_NATS = 3.0  # of every cell's class: with less, too many patterns fit


def mistake_of(cells_nats: Floats, dictionary: Dictionary) -> str:
    """A likely mistake in words, as `looks like ID 7 with …`; "" where none explains the cells.

    `cells_nats`, (n, n): log-likelihood ratio of white's class over black's, as seen in the picture.
    """
    side = dictionary.cells_per_side
    if cells_nats.shape != (side, side) or not (np.abs(cells_nats) >= SURE_NATS).all():
        return ""
    seen = cells_nats > 0
    if (word := _word_like(~seen, dictionary)) is not None:
        return f"looks like ID {word} with its two frequencies swapped: exchange black's and white's outputs"
    if (word := _word_like(seen[:, ::-1], dictionary)) is not None:
        return f"looks like ID {word} mirrored: it was wired as seen from the other side, or a mirror shows it"
    if (word := _word_like(~seen[:, ::-1], dictionary)) is not None:
        return f"looks like ID {word} mirrored and with its two frequencies swapped"
    for name in _larger(dictionary):
        if (word := _word_like(seen, load_dictionary(name))) is not None:
            return f"looks like ID {word} of {name}: panels.dictionary is {dictionary.name}"
    return ""


def _word_like(seen: Bits, dictionary: Dictionary) -> int | None:
    """The ID whose word looks exactly so, turned by quarters."""
    same = (dictionary.rotated_codewords() == seen).all(axis=(2, 3)).any(axis=1)
    return int(same.argmax()) if same.any() else None


def _larger(dictionary: Dictionary) -> list[str]:
    """The predefined dictionaries of as many cells, the smallest first: it is the likelier one."""
    side = dictionary.cells_per_side
    names = [name for name in dictionary_names() if name.startswith(f"DICT_{side}X{side}_") and name != dictionary.name]
    return sorted(names, key=lambda name: len(load_dictionary(name).codewords))
