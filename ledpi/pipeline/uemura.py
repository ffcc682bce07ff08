"""The source paper's method as the path has it: each frame is alone."""

from __future__ import annotations

import time
from collections.abc import Iterator

from ledpi.core.codewords import Dictionary
from ledpi.core.records import Detection, Frame, Rejected
from ledpi.decode.uemura import NO_SQUARE, UemuraReader
from ledpi.pipeline.likelihood import Groups
from ledpi.pipeline.results import Results


class UemuraPath:
    """Reads panels as the paper does, once for each pair of frequencies."""

    def __init__(self, dictionary: Dictionary, groups: Groups) -> None:
        self._readers = [UemuraReader(dictionary, ids, spec) for spec, ids in groups]

    def read(self, frame: Frame, work: Results) -> Iterator[list[Detection]]:
        """All panels of the frame at once."""
        start = time.perf_counter()
        detections = []
        for reader in self._readers:
            steps = reader.read(frame)
            if work.trace is not None:
                work.trace.uemura.append(steps)
                work.trace.searched = True
            if not steps.squares:
                work.rejected.append(NO_SQUARE)
            for square in steps.squares:
                if isinstance(square.result, Rejected):
                    work.reject(square.corners_px, square.result)
                else:
                    detections.append(square.result)
        work.add_time("uemura", start)
        yield detections
