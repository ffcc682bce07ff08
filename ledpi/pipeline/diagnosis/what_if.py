"""Guesses at panels that were built, wired or configured otherwise: a frame is read once more under each.

The path that reads panels does the reading, with all that it asks for before it reports an ID. So a hint is as sure as
an ID, of a frame alone. It takes some hundred times as long as following panels does: for people who look, not for
the daemon.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ledpi.config.panels import PanelSettings
from ledpi.core.codewords import Dictionary
from ledpi.core.geometry import quad_side
from ledpi.core.records import CameraInfo, Detection, Floats, Frame, Intrinsics, RowsFrom
from ledpi.pipeline.diagnosis import look, reasons
from ledpi.pipeline.diagnosis.reasons import Mistake
from ledpi.pipeline.pipeline import Pipeline

# Cells of the predefined dictionaries, the most first: a part of a panel may show a word of fewer cells.
OTHER_SIDES = (7, 6, 5, 4)
AROUND = 0.5  # of a candidate's size, that is looked at around it
MOST_RETUNED = 3  # candidates whose frequencies are sought in one frame


class Supposed(NamedTuple):
    """A panel that is read under a guess."""

    corners_px: Floats  # (4, 2)
    mistake: Mistake


class _Guess(NamedTuple):
    """One way in which panels may be otherwise."""

    pipeline: Pipeline
    flipped: bool  # the picture is, left and right
    says: Callable[[int], Mistake | None]


class WhatIf:
    """For the frames of one camera that looks for `panels`."""

    def __init__(self, camera: CameraInfo, panels: PanelSettings, lens: Intrinsics | None) -> None:
        self._camera, self._panels, self._lens = camera, panels, lens
        self._dictionary = panels.words
        self._made: list[_Guess] = []
        self._to_make = self._make_guesses()

    def readings(
        self, frame: Frame, places_px: Sequence[Floats], found_px: Sequence[Floats], run: Sequence[Frame] = ()
    ) -> list[Supposed]:
        """Reads near `places_px` (4, 2 each), each place by the first guess that explains it.

        `found_px`: those of them at which the cells of a panel were found. `run`: frames of one stream about this one.
        """
        readings = self._from_other_side(run, places_px) if len(run) > 1 else []
        for guess in self._guesses():
            left = [at for at in places_px if not _is_among(at, readings)]
            if not left:
                return readings
            readings += self._under(guess, _only(frame, left))
        for at in [at for at in found_px if not _is_among(at, readings)][:MOST_RETUNED]:
            readings += self._retuned(frame, at)
        return readings

    def _under(self, guess: _Guess, frame: Frame) -> Iterator[Supposed]:
        seen = replace(frame, pixels=frame.pixels[:, ::-1]) if guess.flipped else frame
        for marker in guess.pipeline.decode(seen).markers:
            if (mistake := guess.says(marker.detection.id)) is not None:
                corners = marker.detection.corners_px
                yield Supposed(self._flipped_back(corners) if guess.flipped else corners, mistake)

    def _from_other_side(self, run: Sequence[Frame], places_px: Sequence[Floats]) -> list[Supposed]:
        """Reads the panels to which frames add more where rows run from the other side of the picture.

        A frame alone does not tell: its bands look the same. From frame to frame they move the other way.
        """
        own = self._camera.rows_from
        other: RowsFrom = "above" if own == "below" else "below"
        near = [_only(frame, places_px) for frame in run]
        turned, as_it_is = self._longest_read(near, other), self._longest_read(near, own)
        return [
            Supposed(one.corners_px, reasons.turned(marker_id, other))
            for marker_id, one in turned.items()
            if one.frames_used > 1 and (marker_id not in as_it_is or as_it_is[marker_id].frames_used < one.frames_used)
        ]

    def _longest_read(self, run: Sequence[Frame], rows_from: RowsFrom) -> dict[int, Detection]:
        """By ID, the last of those detections that most frames made."""
        panels = self._panels.model_copy(update={"ids": tuple(range(len(self._dictionary.codewords)))})
        pipeline = Pipeline(replace(self._camera, rows_from=rows_from), panels, intrinsics=self._lens)
        found: dict[int, Detection] = {}
        for one in (marker.detection for frame in run for marker in pipeline.decode(frame).markers):
            if one.id not in found or one.frames_used >= found[one.id].frames_used:
                found[one.id] = one
        return found

    def _retuned(self, frame: Frame, at: Floats) -> list[Supposed]:
        """The candidate (4, 2) at other frequencies."""
        hz = look.propose(frame, at, self._dictionary, self._lens)
        if hz is None or self._panels.phase != "free":
            return []
        black_hz, white_hz = hz
        asked = f"{self._panels.black_hz:g} and {self._panels.white_hz:g}"

        def says(marker_id: int) -> Mistake:
            return Mistake(
                f"looks like ID {marker_id} that blinks at about {black_hz:.0f} and {white_hz:.0f} Hz",
                f"panels.black_hz and panels.white_hz are {asked}: change the panel's firmware or these two settings "
                "so that they match (ledpi calibrate panel measures what is near)",
            )

        guess = self._guess(says, {"black_hz": black_hz, "white_hz": white_hz})
        return list(self._under(guess, _only(frame, [at])))

    def _guesses(self) -> Iterator[_Guess]:
        """The likeliest first, each made when first asked for: dictionaries of a thousand words take a second."""
        yield from self._made
        for guess in self._to_make:
            self._made.append(guess)
            yield guess

    def _make_guesses(self) -> Iterator[_Guess]:
        panels, own = self._panels, self._dictionary
        yield self._guess(reasons.mirrored, flipped=True)
        if panels.phase == "free":
            exchanged = {"black_hz": panels.white_hz, "white_hz": panels.black_hz}
            yield self._guess(reasons.swapped, exchanged)
            yield self._guess(reasons.mirrored_and_swapped, exchanged, flipped=True)
        for side in OTHER_SIDES:
            if others := reasons.other_dictionaries(own, side):
                yield self._guess(partial(_of_smallest, others, own), {"dictionary": others[-1].name})

    def _guess(
        self,
        says: Callable[[int], Mistake | None],
        changes: Mapping[str, object] | None = None,
        *,
        flipped: bool = False,
    ) -> _Guess:
        panels = self._panels.model_copy(update={"overrides": {}, **(changes or {})})
        every = tuple(range(len(panels.words.codewords)))
        panels = panels.model_copy(update={"ids": every})
        lens = self._lens
        if flipped and lens is not None:
            lens = lens.mirrored()
        return _Guess(Pipeline(self._camera, panels, intrinsics=lens, stream=False), flipped, says)

    def _flipped_back(self, corners: Floats) -> Floats:
        """(4, 2), again clockwise in the picture."""
        return np.stack([self._camera.width - 1 - corners[::-1, 0], corners[::-1, 1]], axis=1)


def _of_smallest(others: Sequence[Dictionary], own: Dictionary, marker_id: int) -> Mistake | None:
    """A word of the largest of `others`, each of which begins with the smaller ones; None where it is our own, too."""
    word = others[-1].codewords[marker_id]
    if any(same.shape == word.shape and (same == word).all() for same in own.codewords):
        return None
    smallest = next(other for other in others if marker_id < len(other.codewords))
    return reasons.of_dictionary(marker_id, smallest, own)


def _only(frame: Frame, places_px: Sequence[Floats]) -> Frame:
    """The frame, dark but for what is near these places (4, 2 each): there is less to be searched."""
    pixels = np.zeros_like(frame.pixels)
    height, width = pixels.shape
    for at in places_px:
        reach = AROUND * np.ptp(at, axis=0).max()
        left, top = np.clip(np.floor(at.min(axis=0) - reach), 0, (width, height)).astype(int)
        right, bottom = np.clip(np.ceil(at.max(axis=0) + reach), 0, (width, height)).astype(int)
        pixels[top:bottom, left:right] = frame.pixels[top:bottom, left:right]
    return replace(frame, pixels=pixels)


def _is_among(at: Floats, readings: Sequence[Supposed]) -> bool:
    return any(same_place(at, reading.corners_px) for reading in readings)


def same_place(one: Floats, other: Floats) -> bool:
    """Tells whether two quads (4, 2) may be of one thing: the smaller's middle lies in the larger's inner half."""
    apart = float(np.hypot(*(one.mean(axis=0) - other.mean(axis=0))))
    return apart < 0.35 * max(quad_side(one.tolist()), quad_side(other.tolist()))
