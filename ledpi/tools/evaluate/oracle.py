"""Reads with an oracle for the corners: the same evidence and codewords at true corners, without locating anything."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import lru_cache

from ledpi.core.records import Floats, Frame, Intrinsics, PanelSpec, Quad, Rejected
from ledpi.decode.cells import sample_cells
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.identify import decision
from ledpi.decode.identify.codebook import Codebook
from ledpi.markers.dictionaries import load_dictionary
from ledpi.tools.evaluate.reading import Found, Read

CORNER_SIGMA_PX = 0.01  # of true corners


def read_with_oracle(
    views: Sequence[tuple[Frame, Floats]], lens: Intrinsics | None, dictionary: str, spec: PanelSpec
) -> list[int | None]:
    """The ID that a panel shows in each frame, by all frames until then; None where it is not read.

    `views`: a frame that stands alone, or the frames of a stream in order, each with the panel's true corners, (4, 2)
    px in the marker's order. A codeword that is read rotated counts as none: the corners say which way up it is.
    """
    book, memory = _codebook(dictionary, spec), PanelMemory(spec)
    read: list[int | None] = []
    for frame, corners_px in views:
        quad = Quad(corners_px=corners_px)
        samples = sample_cells(frame, quad, load_dictionary(dictionary).cells_per_side, lens, memory.lattice)
        if isinstance(samples, Rejected):
            read.append(None)
            continue
        memory, _ = memory.add_frame(samples, frame)
        codeword: decision.Reading | Rejected
        if memory.frames == 1:
            codeword = decision.read_codeword(samples, frame, book, decision.FALSE_ID_RATE)
        else:
            evidence = memory.evidence()
            codeword = (
                decision.decide(evidence, book, decision.FALSE_ID_RATE) if isinstance(evidence, Evidence) else evidence
            )
        read.append(None if isinstance(codeword, Rejected) or codeword.quarter_turns else codeword.id)
    return read


def oracle_reads(
    views: Sequence[tuple[Frame, Floats]], lens: Intrinsics | None, dictionary: str, spec: PanelSpec
) -> list[Read]:
    """`read_with_oracle` in the form of any other method's readings, the time shared out over the frames."""
    start = time.perf_counter()
    read = read_with_oracle(views, lens, dictionary, spec)
    milliseconds = 1e3 * (time.perf_counter() - start) / len(views)
    found = [
        () if marker_id is None else (Found(id=marker_id, corners_px=corners_px, pose=None),)
        for marker_id, (_, corners_px) in zip(read, views, strict=True)
    ]
    return [Read(found=each, dropped=(), milliseconds=milliseconds) for each in found]


@lru_cache(maxsize=8)
def _codebook(dictionary: str, spec: PanelSpec) -> Codebook:
    codewords = load_dictionary(dictionary)
    return Codebook.build(list(codewords.readable_ids(spec.phase)), codewords, spec)
