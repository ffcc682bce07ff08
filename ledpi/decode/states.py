"""The states of a track, as a table: each event leads to questions, to another state, or to both.

A frame is an event, by what it shows of the ID that was read. The answer to its questions is the next one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple


class State(Enum):
    """Knowledge of the panel that a track follows, and the frames that it is from."""

    SEARCHING = "none: of earlier frames, if any, only the last one counts"
    UNREAD = "frames have shown no codeword"
    READ = "its ID is known"
    RETUNING = "its ID is known, its frequencies are from few frames: they are estimated again"
    DOUBTED = "its ID was known, but is not told: frames since then do not show it, and are left out"


class Event(Enum):
    """Result of a frame's comparison with the ID that was read; and then of the questions."""

    ADDS = "the frame may show the ID, or none was read yet"
    MATCHES = "the frame clearly shows the ID"
    ADDS_NOTHING = "the frame fails the innovation gate"
    CONTRADICTS = "the frame shows something else"
    CODEWORD = "a question has led to an ID"
    ROUGHLY = "a question has led to an ID, at frequencies that are from few frames"
    NONE = "no question has led to an ID"


class Ask(Enum):
    """A question, asked if the one before it stays open."""

    ALL = "which codeword do all frames show?"
    NEWEST = "which does the newest frame show by itself?"
    AT_TIMES = "the same, while there are few frames, and of one in eight: the old ones may be wrong"
    STILL = "do all frames show the ID that was read, at lower odds?"


class Rule(NamedTuple):
    """A field of the table."""

    to: State | None = None  # None: the same
    asks: tuple[Ask, ...] = ()
    frames: float = math.inf  # that a track may be in this state, then:
    then: Rule | None = None


READ_EVERY = 9  # of frames that match one is read again: by then a panel may look different, and the margin has grown
DOUBT_FRAMES = 4  # then those before are out of date
# Frames without a reading: what is seen longer is a lamp or a window, and is looked at when all is searched anyway.
FOLLOWED_FRAMES = {State.SEARCHING: 16, State.UNREAD: 16}

_READ, _ROUGH, _UNREAD, _DOUBT = (Rule(to) for to in (State.READ, State.RETUNING, State.UNREAD, State.DOUBTED))
_FIRST, _ALONE = Rule(asks=(Ask.ALL, Ask.AT_TIMES)), Rule(asks=(Ask.NEWEST,))
_ASK, _OTHER = Rule(asks=(Ask.ALL, Ask.NEWEST, Ask.STILL)), Rule(State.SEARCHING, (Ask.ALL,))
_TRUST = Rule(frames=READ_EVERY, then=_ASK)
_WAIT = _DOUBT._replace(frames=DOUBT_FRAMES, then=Rule(State.SEARCHING))
_ROWS = {  # ADDS, MATCHES, ADDS_NOTHING, CONTRADICTS, CODEWORD, ROUGHLY, NONE
    State.SEARCHING: (_FIRST, None, None, None, _READ, _ROUGH, _UNREAD),
    State.UNREAD: (_FIRST, None, None, None, _READ, _ROUGH, _UNREAD),
    State.READ: (_ASK, _TRUST, _ALONE, _OTHER, _READ, _ROUGH, _DOUBT),
    State.RETUNING: (_ASK, _ASK, _ALONE, _OTHER, _READ, _ROUGH, _DOUBT),
    State.DOUBTED: (_ASK, _ASK, _ALONE, _OTHER, _READ, _ROUGH, _WAIT),
}
# Nothing matches, or contradicts, where no ID was read.
TABLE: Mapping[State, Mapping[Event, Rule]] = {
    state: {event: rule for event, rule in zip(Event, rules, strict=True) if rule} for state, rules in _ROWS.items()
}


def rule_of(state: State, event: Event, frames: int) -> Rule:
    """The rule for an event after so many frames in this state."""
    rule = TABLE[state][event]
    return rule if rule.then is None or frames < rule.frames else rule.then
