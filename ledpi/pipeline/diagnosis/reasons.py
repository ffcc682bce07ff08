"""Words for people: why something was rejected, why there is no fix, and what a panel looks like that is none."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ledpi.config.shipped import reasons
from ledpi.core.codewords import Bits, Dictionary
from ledpi.core.dictionaries import dictionary_names, load_dictionary
from ledpi.core.records import Floats, RowsFrom

# As the status says it (`NoFix`), and as a frame's own reasons do (`fix.…`).
_WORDS = {
    "not_running": "ledpi is starting or stopping",
    "no_frames": "the camera delivers nothing",
    "uncalibrated": "the lens is not calibrated",
    "no_map": "no map is set",
    "no_panel": "no panel is in view",
    "not_in_map": "no panel of the map is in view",
    "rejected": "panels contradict the map",
    "panels_contradict": "panels contradict the map",
    "ambiguous": "one panel is in view, and its mirror pose is not excluded",
    "stale": "the last one is too old",
    "behind": "decoding is too slow",
}
SURE_NATS = 3.0  # of every cell's class: with less, too many patterns fit


class Explained(NamedTuple):
    """A reason in words."""

    means: str
    helps: str  # "" where nothing is to be done


def explained(key: str) -> Explained:
    """A key like `find.too_small`, as docs/troubleshooting.md has it; of one that is not there, the key itself."""
    stage, _, reason = key.partition(".")
    return Explained(*reasons().get(key, (f"{stage}: {reason.replace('_', ' ')}", "")))


def why_no_fix(why: str) -> str:
    """Returns words for `why`, which a newer daemon may say, too."""
    return _WORDS.get(why.lower(), why.lower().replace("_", " "))


class Mistake(NamedTuple):
    """The word that a panel looks like, and what is to be done about it."""

    says: str
    helps: str


def swapped(word: int) -> Mistake:
    """Black's cells blink at white's frequency, and the other way round."""
    return Mistake(
        f"looks like ID {word} with its two frequencies swapped",
        "exchange black's and white's outputs, or panels.black_hz and panels.white_hz",
    )


def mirrored(word: int) -> Mistake:
    """Left and right are exchanged."""
    return Mistake(
        f"looks like ID {word} mirrored",
        "it was wired as seen from the other side, or a mirror shows it: compare it with its wiring picture",
    )


def mirrored_and_swapped(word: int) -> Mistake:
    """Both."""
    return Mistake(
        f"looks like ID {word} mirrored and with its two frequencies swapped",
        "it was wired as seen from the other side: compare it with its wiring picture, and exchange the outputs",
    )


def of_dictionary(word: int, other: Dictionary, configured: Dictionary) -> Mistake:
    """A word of another dictionary than the configured one."""
    return Mistake(
        f"looks like ID {word} of {other.name}",
        f"panels.dictionary is {configured.name}: change the panel or this setting so that they match",
    )


def turned(word: int, rows_from: RowsFrom) -> Mistake:
    """Rows were read out from the other side of the picture than configured."""
    why = {"below": "a program turned the picture by 180° after read-out", "above": "the picture is as it was read out"}
    return Mistake(
        f"this is ID {word}, if the picture's rows run from {rows_from}: {why[rows_from]}",
        f"set camera.rows_from: {rows_from}",
    )


def mistake_of(cells_nats: Floats, dictionary: Dictionary) -> Mistake | None:
    """A likely mistake; None where none explains the cells, or where they are a word as they are.

    `cells_nats`, (n, n): log-likelihood ratio of white's class over black's, as seen in the picture.
    """
    side = dictionary.cells_per_side
    if cells_nats.shape != (side, side) or not (np.abs(cells_nats) >= SURE_NATS).all():
        return None
    seen = cells_nats > 0
    if _word_like(seen, dictionary) is not None:
        return None
    for cells, mistake in ((~seen, swapped), (seen[:, ::-1], mirrored), (~seen[:, ::-1], mirrored_and_swapped)):
        if (word := _word_like(cells, dictionary)) is not None:
            return mistake(word)
    for other in other_dictionaries(dictionary, side):
        if (word := _word_like(seen, other)) is not None:
            return of_dictionary(word, other, dictionary)
    return None


def other_dictionaries(dictionary: Dictionary, side: int) -> list[Dictionary]:
    """The predefined ones of so many cells along a side, the smallest first: it is the likelier one."""
    names = [name for name in dictionary_names() if name.startswith(f"DICT_{side}X{side}_") and name != dictionary.name]
    return sorted((load_dictionary(name) for name in names), key=lambda other: len(other.codewords))


def _word_like(seen: Bits, dictionary: Dictionary) -> int | None:
    """The ID whose word looks exactly so, turned by quarters."""
    same = (dictionary.rotated_codewords() == seen).all(axis=(2, 3)).any(axis=1)
    return int(same.argmax()) if same.any() else None
