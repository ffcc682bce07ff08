"""Reads with an oracle for the corners: the same fit, evidence and codewords, begun at true corners."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from functools import lru_cache

from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import Floats, Frame, Intrinsics, PanelSpec, Rejected
from ledpi.decode.evidence.cells import Observation
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.history import History, Identity
from ledpi.decode.identify import decision
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.locate import Locator
from ledpi.decode.reader import Reader
from ledpi.workshop.evaluate.scoring import Found, Read

Views = Sequence[tuple[Frame, Floats]]  # frames of a stream in order, each with a panel's true corners, (4, 2) px


def observed(views: Views, lens: Intrinsics | None, dictionary: str, spec: PanelSpec) -> Iterator[Observation | None]:
    """The light within the true corners; None where no panel fits there."""
    cells = load_dictionary(dictionary).cells_per_side
    locator = Locator(cells, (spec,), lens, must_blink=False)
    for frame, corners_px in views:
        quad = locator.localise(frame, corners_px)
        seen = quad if isinstance(quad, Rejected) else locator.observe(frame, quad)
        yield None if isinstance(seen, Rejected) else seen


def read_with_oracle(views: Views, lens: Intrinsics | None, dictionary: str, spec: PanelSpec) -> list[int | None]:
    """The ID that a panel shows in each frame, by all frames until then; None where it is not read.

    Corners are in the marker's order: a codeword that is read rotated counts as none.
    """
    weigher = LightWeigher(load_dictionary(dictionary).cells_per_side, lens)
    reader = Reader([codebook(dictionary, spec)], weigher, decision.FALSE_ID_RATE)
    history = History.empty((spec,))
    read: list[int | None] = []
    for seen in observed(views, lens, dictionary, spec):
        identity = None
        if seen is not None:
            outcome = reader.read(history, seen)
            history, identity = outcome.history, outcome.identity
        upright = isinstance(identity, Identity) and identity.reading.quarter_turns == 0
        read.append(identity.reading.id if isinstance(identity, Identity) and upright else None)
    return read


def oracle_reads(views: Views, lens: Intrinsics | None, dictionary: str, spec: PanelSpec) -> list[Read]:
    """`read_with_oracle` in the form of any other method's readings, the time shared out over the frames."""
    start = time.perf_counter()
    ids = read_with_oracle(views, lens, dictionary, spec)
    milliseconds = 1e3 * (time.perf_counter() - start) / len(views)
    read = []
    for marker_id, (_, corners_px) in zip(ids, views, strict=True):
        found = () if marker_id is None else (Found(id=marker_id, corners_px=corners_px, pose=None),)
        read.append(Read(found=found, dropped=(), milliseconds=milliseconds))
    return read


@lru_cache(maxsize=8)
def codebook(dictionary: str, spec: PanelSpec) -> Codebook:
    """The codewords that can be read."""
    codewords = load_dictionary(dictionary)
    return Codebook.build(list(codewords.readable_ids(spec.phase)), codewords, spec)
