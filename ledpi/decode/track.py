"""Follows each lit square from frame to frame, so that what several frames say of one panel can be added up."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ledpi.decode.evidence import Doubles, Evidence
from ledpi.decode.memory import PanelMemory
from ledpi.records import Floats, PanelSpec, Quad, Rejected

NOT_SHOWN = Rejected(stage="track", reason="not_shown")

MAX_GAP_NS = 500_000_000  # tracks do not survive a longer one (the recording format says so)
# Between two frames a square's centre may miss its prediction by this share of its side, and its side may change by the
# other.
MAX_SHIFT, MAX_GROWTH = 0.35, 1.25
# A frame that is e^DOUBT times likelier without a panel's bands than with them does not show the panel. One that does
# show it looks so in less than 1 of 1,000, however much or little a frame can tell: with E = bands·information·bands/2,
# the log-likelihood ratio is normal with mean E and variance 2E, so (E + DOUBT)/√(2E) is at least √(2·DOUBT) = 3.2.
DOUBT = 5.0
# Where cells would rather be of the other class, by this much together, another panel has taken the place. Cells that
# are what they were gain by noise alone: 0.2 each on average, whatever their evidence E (mean of max(0, N(−E, 2E))).
# The rest is for bands that are not known exactly yet.
OTHER_CELLS = 16.0


@dataclass(slots=True)
class Track:
    """One lit square over time. Changed by `Tracker` and by the path, frame by frame."""

    corners_px: Floats  # (4, 2) as last seen, in the order of the first frame
    velocity_px_s: Floats  # (2,) of the centre
    seen_ns: int  # row 0's read-out of the frame
    memories: tuple[PanelMemory, ...]  # one for each pair of frequencies
    shown: tuple[int, Doubles] | None = None  # which memory read a word last, and the (cells, 4) bands of that word

    def forget(self) -> None:
        """What was seen here was something else."""
        self.memories = tuple(PanelMemory(memory.spec) for memory in self.memories)
        self.shown = None


class Tracker:
    """The tracks of one stream."""

    def __init__(self, specs: tuple[PanelSpec, ...]) -> None:
        self._specs = specs
        self._tracks: list[Track] = []

    def follow(self, quads: list[Quad], now_ns: int) -> list[tuple[Quad, Track]]:
        """Each quad with the track that it continues, or begins; its corners in the track's order.

        The nearest pair first, and none twice, so that neighbours do not swap. Tracks not seen for MAX_GAP_NS end.
        """
        self._tracks = [t for t in self._tracks if 0 < now_ns - t.seen_ns <= MAX_GAP_NS]
        pairs = [
            (distance, i, j)
            for i, quad in enumerate(quads)
            for j, track in enumerate(self._tracks)
            if (distance := _distance(quad, track, now_ns)) is not None
        ]
        partner: dict[int, int] = {}
        for _, i, j in sorted(pairs):
            if i not in partner and j not in partner.values():
                partner[i] = j
        followed = []
        for i, quad in enumerate(quads):
            if i in partner:
                track = self._tracks[partner[i]]
                quad = _in_order_of(quad, track)
                moved = quad.corners_px.mean(axis=0) - track.corners_px.mean(axis=0)
                track.velocity_px_s = moved / ((now_ns - track.seen_ns) * 1e-9)
                track.corners_px, track.seen_ns = quad.corners_px, now_ns
            else:
                track = Track(quad.corners_px, np.zeros(2), now_ns, tuple(PanelMemory(s) for s in self._specs))
                self._tracks.append(track)
            followed.append((quad, track))
        return followed


def contradicts(added: Evidence | None, shown: Doubles) -> bool:
    """Whether a frame denies bands (cells, 4) that the frames before it have shown: none, or in other cells."""
    if added is None:
        return False
    left = added.score - np.einsum("cidj,dj->ci", added.information, shown)
    likelihood = 0.5 * float((shown * (added.score + left)).sum())  # shown·score − shown·information·shown/2
    if likelihood < -DOUBT:
        return True
    black, white = shown[:, :2].any(axis=1), shown[:, 2:].any(axis=1)
    if not (black.any() and white.any()):
        return False
    bands = np.concatenate([shown[black][0, :2], shown[white][0, 2:]])
    change = np.where(shown != 0, 0.0, bands) - shown  # of a cell that changes its class
    own = np.einsum("cicj->cij", added.information)
    gain = (change * left).sum(axis=1) - 0.5 * np.einsum("ci,cij,cj->c", change, own, change)
    return float(np.maximum(gain, 0.0).sum()) > OTHER_CELLS


def _side(corners: Floats) -> float:
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = corners.tolist()
    return math.sqrt(max(1e-9, 0.5 * abs((x2 - x0) * (y3 - y1) - (x3 - x1) * (y2 - y0))))


def _distance(quad: Quad, track: Track, now_ns: int) -> float | None:
    """How far a quad is from where a track is expected, in sides; None where it cannot be the same."""
    side = _side(quad.corners_px)
    expected = track.corners_px.mean(axis=0) + track.velocity_px_s * ((now_ns - track.seen_ns) * 1e-9)
    away = quad.corners_px.mean(axis=0) - expected
    distance = math.hypot(away[0], away[1]) / side
    growth = side / _side(track.corners_px)
    return distance if distance < MAX_SHIFT and 1 / MAX_GROWTH < growth < MAX_GROWTH else None


def _in_order_of(quad: Quad, track: Track) -> Quad:
    """The quad with its corners turned so that each is the one of the track that it continues."""
    centred = quad.corners_px - quad.corners_px.mean(axis=0)
    before = track.corners_px - track.corners_px.mean(axis=0)
    turns = max(range(4), key=lambda k: float((np.roll(centred, -k, axis=0) * before).sum()))
    return quad if turns == 0 else replace(quad, corners_px=np.roll(quad.corners_px, -turns, axis=0))
