"""Words behind a panel's cells that show none: built, wired or configured otherwise; and the reasons in words."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ledpi.core.dictionaries import load_dictionary
from ledpi.pipeline.diagnosis.reasons import explained, mistake_of

DICTIONARY = load_dictionary("DICT_4X4_50")
SURE = 20.0  # nats


def nats(word: np.ndarray) -> np.ndarray:
    return np.where(word, SURE, -SURE)


@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize(
    ("built", "told"),
    [
        (lambda word: ~word, "ID 11 with its two frequencies swapped"),
        (lambda word: word[:, ::-1], "ID 11 mirrored"),
        (lambda word: ~word[:, ::-1], "ID 11 mirrored and with its two frequencies swapped"),
    ],
)
def test_a_panel_that_was_built_wrongly_is_recognized(built: Any, told: str, turns: int) -> None:
    """However it is turned."""
    mistake = mistake_of(nats(np.rot90(built(DICTIONARY.codeword(11)), turns)), DICTIONARY)
    assert mistake is not None
    assert told in mistake.says
    assert mistake.helps


def test_a_word_of_a_larger_dictionary_is_recognized() -> None:
    """With the smallest one's name."""
    mistake = mistake_of(nats(load_dictionary("DICT_4X4_100").codeword(80)), DICTIONARY)
    assert mistake is not None
    assert mistake.says == "looks like ID 80 of DICT_4X4_100"


def test_a_word_as_it_should_be_is_no_mistake() -> None:
    """Though larger dictionaries have it, too: something else keeps it from being read."""
    assert mistake_of(nats(DICTIONARY.codeword(11)), DICTIONARY) is None


def test_unsure_cells_explain_nothing() -> None:
    """One of them is enough; nor does a pattern that is no word in any way."""
    unsure = nats(~DICTIONARY.codeword(11))
    unsure[2, 2] = 1.0
    assert mistake_of(unsure, DICTIONARY) is None
    assert mistake_of(nats(np.ones((4, 4), bool)), DICTIONARY) is None
    assert mistake_of(nats(np.ones((5, 5), bool)), DICTIONARY) is None


def test_reasons_are_those_of_the_documents() -> None:
    """As text, with what helps."""
    assert explained("fix.not_in_map") == (
        "no panel in view is in the map",
        "add it to the map, unless it is on a body",
    )


def test_a_reason_of_a_newer_daemon_is_shown_by_its_name() -> None:
    """Rather than not at all."""
    assert explained("soft.something_new") == ("soft: something new", "")
