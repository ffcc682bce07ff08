"""Remembers where each panel was, so that a frame which alone would leave a little doubt need not be thrown away.

A track is prior odds for one reading at one place, nothing more: the frame itself must still show bands, and must
itself make that ID its likeliest one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ledpi.records import Floats, Quad, Sighting

MAX_GAP_NS = 500_000_000  # tracks do not survive a longer one (the recording format says so)
MAX_FRAMES = 255
# Between two frames a panel's centre may differ from its prediction by this share of its side, its side by the other.
MAX_SHIFT, MAX_GROWTH = 0.35, 1.25


@dataclass(frozen=True, slots=True, kw_only=True)
class Track:
    """One panel as last seen."""

    id: int
    corners_px: Floats  # (4, 2) of the marker
    velocity_px_s: Floats  # (2,) of its centre
    seen_ns: int
    frames: int  # that agreed, so far


class Tracker:
    """The tracks of one stream."""

    def __init__(self) -> None:
        self._tracks: list[Track] = []

    def expect(self, quad: Quad, row0_readout_ns: int) -> Track | None:
        """The track whose panel this quad continues, if any."""
        centre, side = quad.corners_px.mean(axis=0), _side(quad.corners_px)
        best, nearest = None, MAX_SHIFT
        for track in self._tracks:
            passed_s = (row0_readout_ns - track.seen_ns) * 1e-9
            away = centre - track.corners_px.mean(axis=0) - track.velocity_px_s * passed_s
            distance = math.hypot(away[0], away[1]) / side
            growth = side / _side(track.corners_px)
            if distance < nearest and 1 / MAX_GROWTH < growth < MAX_GROWTH:
                best, nearest = track, distance
        return best

    def update(self, sightings: list[Sighting], row0_readout_ns: int) -> None:
        """Takes in what this frame showed; forgets what has not been seen for too long."""
        kept = [t for t in self._tracks if 0 <= row0_readout_ns - t.seen_ns <= MAX_GAP_NS]
        for sighting in sightings:
            old = next((t for t in kept if t.id == sighting.id), None)
            if old is not None:
                kept.remove(old)
            kept.append(_continued(old, sighting, row0_readout_ns))
        self._tracks = kept


def _side(corners: Floats) -> float:
    x, y = corners[:, 0], corners[:, 1]
    return math.sqrt(max(1e-9, 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))))


def _continued(old: Track | None, sighting: Sighting, seen_ns: int) -> Track:
    new = Track(
        id=sighting.id,
        corners_px=sighting.corners_px,
        velocity_px_s=np.zeros(2),
        seen_ns=seen_ns,
        frames=1,
    )
    if old is None or seen_ns <= old.seen_ns:
        return new
    moved = sighting.corners_px.mean(axis=0) - old.corners_px.mean(axis=0)
    if math.hypot(moved[0], moved[1]) > 2 * _side(sighting.corners_px):  # elsewhere: another panel of the same ID
        return new
    velocity = moved / ((seen_ns - old.seen_ns) * 1e-9)
    return replace(new, velocity_px_s=velocity, frames=min(MAX_FRAMES, old.frames + 1))
