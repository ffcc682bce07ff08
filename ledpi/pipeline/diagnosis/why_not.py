"""Why panels are not read in the frames of one camera: each picture at once, and the guesses that take long beside."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

from ledpi.config.panels import PanelSettings
from ledpi.core.records import CameraInfo, Floats, Frame, Intrinsics
from ledpi.pipeline.diagnosis.diagnose import (
    Diagnosis,
    Note,
    NotRead,
    diagnose,
    found_cells,
    in_order,
    picture_notes,
    worth_a_guess,
)
from ledpi.pipeline.diagnosis.what_if import Supposed, WhatIf, same_place

REST_S = 1.0  # between two rounds of guesses, at least; and at least as long as one has taken
KEPT_S = 4.0  # for which a guess stays: a panel that is taken away must not be told of for long
RECENT_S = 0.8  # for which a thing that is not told again stays: a stream searches the whole picture now and then only
RUN_FRAMES = 12  # of a stream: a far panel takes up to six or so to be read
_LEAST_PRIORITY = 10


class Why(NamedTuple):
    """The explanations of one frame."""

    diagnoses: list[Diagnosis]
    notes: list[Note]

    @property
    def told(self) -> list[Diagnosis]:
        """All but what most likely is no panel."""
        return [one for one in self.diagnoses if one.kind != "shape"]


class WhyNot:
    """Explains the frames of one camera that looks for `panels`; from one thread, or from several."""

    def __init__(self, camera: CameraInfo, panels: PanelSettings, lens: Intrinsics | None) -> None:
        self._panels = panels
        self._what_if = WhatIf(camera, panels, lens)
        self._recent: list[tuple[float, Diagnosis]] = []  # when it was told, CLOCK_MONOTONIC
        self._supposed: list[Supposed] = []
        self._until_s = 0.0  # for which these hold
        self._next_s = 0.0  # from when on guesses are made again
        self._guessing = threading.Lock()

    def explain(
        self, frame: Frame, not_read: Sequence[NotRead], read_px: Sequence[Floats], run: Sequence[Frame] = ()
    ) -> Why:
        """All that can be said, however long it takes. `run`: frames of one stream about this one, RUN_FRAMES do."""
        with self._guessing:
            supposed = self._guess(frame, _apart(not_read, read_px), run)
        return self._why(frame, not_read, read_px, supposed)

    def explain_at_once(self, frame: Frame, not_read: Sequence[NotRead], read_px: Sequence[Floats]) -> Why:
        """Explains what can be said now; guesses are those of a frame just before, and are made anew beside."""
        now_s = time.monotonic()
        if now_s >= self._next_s:
            self._next_s = float("inf")
            args = frame, _apart(not_read, read_px)
            threading.Thread(target=self._guess_beside, args=args, name="guess", daemon=True).start()
        why = self._why(frame, not_read, read_px, self._supposed if now_s < self._until_s else [])
        return why._replace(diagnoses=self._with_recent(now_s, why.diagnoses, read_px))

    def _with_recent(self, now_s: float, told: list[Diagnosis], read_px: Sequence[Floats]) -> list[Diagnosis]:
        """And those of the frames just before, where this one says nothing."""
        taken = [*read_px, *(one.corners_px for one in told)]
        kept = [
            (at_s, one)
            for at_s, one in self._recent
            if now_s - at_s < RECENT_S and not any(same_place(one.corners_px, at) for at in taken)
        ]
        self._recent = [*((now_s, one) for one in told), *kept]
        return in_order([*told, *(one for _, one in kept)])

    def _why(
        self, frame: Frame, not_read: Sequence[NotRead], read_px: Sequence[Floats], supposed: Sequence[Supposed]
    ) -> Why:
        diagnoses = diagnose(frame, self._panels, not_read, read_px, supposed)
        return Why(diagnoses, picture_notes(frame, self._panels))

    def _guess(self, frame: Frame, not_read: Sequence[NotRead], run: Sequence[Frame]) -> list[Supposed]:
        worth = [one for one in not_read if worth_a_guess(frame, one)]
        return self._what_if.readings(
            frame, [one.corners_px for one in worth], [one.corners_px for one in worth if found_cells(one)], run
        )

    def _guess_beside(self, frame: Frame, not_read: Sequence[NotRead]) -> None:
        with suppress(OSError, AttributeError):  # of this thread alone, as Linux does
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _LEAST_PRIORITY)
        since_s = time.monotonic()
        try:
            with self._guessing:
                self._supposed = self._guess(frame, not_read, ())
        finally:
            now_s = time.monotonic()
            self._next_s = now_s + max(REST_S, now_s - since_s)
            self._until_s = self._next_s + KEPT_S


def _apart(not_read: Sequence[NotRead], read_px: Sequence[Floats]) -> list[NotRead]:
    """Those that are no part of a panel that was read."""
    return [one for one in not_read if not any(same_place(one.corners_px, at) for at in read_px)]
