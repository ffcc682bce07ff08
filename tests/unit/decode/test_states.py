"""A track's states: its panel is painted, frame by frame, and each field of the table is gone through."""

from __future__ import annotations

import dataclasses
import functools
from typing import NamedTuple

import pytest

from ledpi.core.dictionaries import load_dictionary
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.history import History
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.decision import FALSE_ID_RATE
from ledpi.decode.observation import Observation
from ledpi.decode.reader import Reader
from ledpi.decode.states import TABLE, Event, Rule, State
from tests.builders import ROOT
from tests.builders.decode import FRAME_ROWS, ROW_TIME_US, SPEC, Canvas, square, word
from tests.builders.samples import observed

SIDES = {"near": 75, "far": 36}
PANELS = {  # whose oscillators are off; frequencies are searched for where a story has "off"
    "drifting": dataclasses.replace(SPEC, white_hz=2440.0),
    "off": dataclasses.replace(SPEC, black_hz=1262.0, white_hz=2431.0),
    "beside-off": dataclasses.replace(SPEC, black_hz=1262.0, white_hz=2431.0),
    "half-off": dataclasses.replace(SPEC, white_hz=2440.0),
}
ASIDE = {"beside": 0.08, "aside": 0.2}  # of a side, by which the panel's lattice was taken elsewhere
FRAME_EVENTS = (Event.ADDS, Event.MATCHES, Event.ADDS_NOTHING, Event.CONTRADICTS)


class Step(NamedTuple):
    """One frame: what it shows, which event it is, and the track's state after it."""

    shows: str
    event: Event
    state: State


def steps(story: str) -> list[Step]:
    """Each of a story's: how many frames, what they show, their event, and the state after each."""
    lines = [line.split() for line in story.split(", ")]
    return [Step(what, Event[event], State[state]) for n, what, event, state in lines for _ in range(int(n))]


FIVE_OFF = (
    "1 off ADDS READ, 1 off MATCHES READ, 1 off CONTRADICTS READ, 1 off MATCHES READ, 1 off CONTRADICTS RETUNING, "
)
STORIES = {  # the first word is the distance
    "near, of nine frames that match one is read again": "1 panel ADDS READ, 11 panel MATCHES READ",
    "near, another panel takes the place": (
        "1 panel ADDS READ, 2 panel MATCHES READ, 1 other CONTRADICTS READ, 1 other MATCHES READ"
    ),
    "near, a lamp takes the place": (
        "1 panel ADDS READ, 2 panel MATCHES READ, 1 lamp CONTRADICTS UNREAD, 3 lamp ADDS UNREAD"
    ),
    "near, a frame that is a little off is doubted, or not": (
        "1 panel ADDS READ, 1 panel MATCHES READ, 1 beside ADDS READ, 1 aside ADDS_NOTHING DOUBTED, 1 beside ADDS READ"
    ),
    "far, one frame does not show enough": (
        "1 panel ADDS UNREAD, 1 panel ADDS READ, 3 panel MATCHES READ, 2 aside ADDS_NOTHING DOUBTED, "
        "1 panel MATCHES READ"
    ),
    "near, four frames aside are left out, the next begins anew": (
        "1 panel ADDS READ, 2 panel MATCHES READ, 4 aside ADDS_NOTHING DOUBTED, 1 aside ADDS_NOTHING SEARCHING, "
        "1 panel ADDS READ"
    ),
    "near, of frames that do not add up the newest still shows the ID": (
        "1 drifting ADDS READ, 8 drifting MATCHES READ, 1 drifting ADDS_NOTHING READ, 2 drifting MATCHES READ"
    ),
    "near, what was doubted was another panel": (
        "1 panel ADDS READ, 2 panel MATCHES READ, 2 aside ADDS_NOTHING DOUBTED, 1 other CONTRADICTS READ"
    ),
    "near, frequencies that are found in five frames are certain from twelve on": (
        f"{FIVE_OFF}7 off MATCHES RETUNING, 3 off MATCHES READ"
    ),
    "near, frequencies that were found outlast a doubt, and another panel": (
        f"{FIVE_OFF}2 off MATCHES RETUNING, 2 aside ADDS_NOTHING DOUBTED, 2 off MATCHES RETUNING, "
        "1 panel CONTRADICTS RETUNING"
    ),
    "near, a frame that is a little off keeps frequencies that were found": f"{FIVE_OFF}2 beside-off ADDS RETUNING",
    "far, frequencies that are found make a panel readable": (
        "3 off ADDS UNREAD, 1 off ADDS RETUNING, 3 off MATCHES RETUNING"
    ),
    "near, a class that is half as far off shows it after ten frames": (
        "1 half-off ADDS READ, 8 half-off MATCHES READ, 1 half-off ADDS_NOTHING RETUNING, 1 half-off MATCHES RETUNING"
    ),
}


@functools.cache
def frame_of(distance: str, shows: str, number: int) -> Observation:
    """Frame `number` of what a story shows there."""
    corners, canvas = square(300.3, 200.6, SIDES[distance], 8.0), Canvas()
    if shows == "lamp":
        canvas.lamp(corners, 0.4)
    else:
        spec, start_us = PANELS.get(shows, SPEC), number * FRAME_ROWS * ROW_TIME_US
        canvas.panel(corners, word(23 if shows == "other" else 7), spec=spec, start_us=start_us)
    moved = (corners[1] - corners[0]) * ASIDE.get(shows.split("-")[0], 0.0)
    return observed(canvas.frame(seed=number, seq=number), corners + moved)


def told(story: str) -> tuple[list[Step], History]:
    """Each frame's step as the reader makes it, and the history that they lead to."""
    book = Codebook.build(range(50), load_dictionary("DICT_4X4_50"), SPEC)
    reader = Reader([book], LightWeigher(4, None), FALSE_ID_RATE, search_frequencies="off" in STORIES[story])
    history, seen = History.empty((SPEC,)), []
    for number, step in enumerate(steps(STORIES[story])):
        outcome = reader.read(history, frame_of(story.split(",")[0], step.shows, number))
        history = outcome.history
        seen.append(Step(step.shows, outcome.event, history.state))
    return seen, history


@pytest.mark.slow
@pytest.mark.parametrize("story", STORIES)
def test_a_track_goes_through_its_states(story: str) -> None:
    """Frame by frame, as painted panels lead to them."""
    assert told(story)[0] == steps(STORIES[story])


def test_what_matches_is_counted_from_the_frame_that_was_read_last() -> None:
    """The tenth frame was read again, and two have matched since."""
    assert told("near, of nine frames that match one is read again")[1].frames_in_state == 3


def test_each_field_of_the_table_is_in_a_story() -> None:
    """A field that no painted panel reaches would be held by nothing. What contradicts is decided while SEARCHING."""
    reached = set()
    for story in STORIES.values():
        before = State.SEARCHING
        for step in steps(story):
            found = {State.READ: Event.CODEWORD, State.RETUNING: Event.ROUGHLY}.get(step.state, Event.NONE)
            asked = State.SEARCHING if step.event is Event.CONTRADICTS else before
            reached |= {(before, step.event), (asked, found)}
            before = step.state
    assert reached == {(state, event) for state, rules in TABLE.items() for event in rules}


def field(rule: Rule | None) -> str:
    """A field as the page draws it."""
    if rule is None:
        return ""
    parts = [f"→ {rule.to.name}"] if rule.to else []
    parts += [ask.name.lower() for ask in rule.asks]
    return (", ".join(parts) or "–") + (f" ({rule.frames} frames, then {field(rule.then)})" if rule.then else "")


def test_the_page_draws_the_table() -> None:
    """Each state and event, each field as the code has it, and none that it does not have."""
    page = (ROOT / "docs/architecture.md").read_text(encoding="utf-8").splitlines()
    begin = page.index("| state | " + " | ".join(event.name for event in Event) + " |") + 2
    rows = [line.strip("|").split("|") for line in page[begin : page.index("", begin)]]
    drawn = {cells[0].strip(): [cell.strip() for cell in cells[1:]] for cells in rows}
    assert drawn == {state.name: [field(TABLE[state].get(event)) for event in Event] for state in State}
