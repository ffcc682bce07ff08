"""Tracks each lit square from frame to frame, so that the evidence of several frames of one panel can be added up."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np

from ledpi.core.geometry import corners_apart, quad_middle, quad_side
from ledpi.core.records import MAX_GAP_NS, Floats, PanelSpec, Quad, Rejected
from ledpi.decode.history import History
from ledpi.decode.model.picture import PanelPicture
from ledpi.decode.model.prior import turned_unknown
from ledpi.decode.states import FOLLOWED_FRAMES

Place: TypeAlias = tuple[tuple[float, float], float]  # centre and side of a square, in pixels

CONTRADICTED = Rejected(stage="track", reason="contradicted")
SAME_PLACE = Rejected(stage="track", reason="same_place")  # as a square that leaves less, or the same again

# Between two frames a square's centre may miss its prediction by this share of its side, and its side may change by the
# other.
MAX_SHIFT, MAX_GROWTH = 0.35, 1.25
# And its corners about its centre, size apart, move by no more than this share: a camera that passes a panel at 1 m/s,
# 0.4 m away, sees it turn by 0.08 rad in 33 ms, which moves a corner by half as many sides.
MAX_RESHAPED = 0.1
# A fit that leaves so many times more than the one before has settled beside the panel: it is searched for.
WORSE = 4.0
SAME = 0.01  # of the side: squares no further apart, and in size, are one
OVERLAP = 0.5  # of the larger one's side: squares whose middles are no further apart are not both panels
# In cells, from corner to corner: squares no further apart show the same cells; and from candidates no further apart
# fits come to the same lattice, unless an end of one may be in a dark band.
SAME_CELLS, SAME_START = 0.25, 0.5
# How much of a corner's velocity the last step alone decides: the noise of two corners weighs on it, but a robot that
# brakes changes it by a tenth from frame to frame.
NEW_VELOCITY = 0.7


class TrackState(NamedTuple):
    """The state of a track: where the last frame with its square has shown it, and how it moves."""

    corners_px: Floats  # (4, 2) in the order of the track's first frame
    covariance_px2: Floats | None  # (8, 8) of the corners
    velocity_px_s: Floats | None  # (4, 2), None where it was seen once
    velocity_covariance: Floats | None  # (8, 8) px²/s²
    seen_ns: int  # row 0's read-out of the frame
    unknown: Floats | None  # what its picture was fitted with
    residual: float  # that its fit left

    @classmethod
    def from_quad(cls, quad: Quad, now_ns: int) -> TrackState:
        """The state of a square that was measured as `quad`."""
        return cls(quad.corners_px, quad.covariance_px2, None, None, now_ns, quad.unknown, quad.residual)

    def update(self, quad: Quad, now_ns: int) -> TrackState:
        """The state after a new measurement `quad`, whose corners are in the track's order."""
        elapsed_s = (now_ns - self.seen_ns) * 1e-9
        velocity = (quad.corners_px - self.corners_px) / elapsed_s
        covariance = None
        if quad.covariance_px2 is not None and self.covariance_px2 is not None:
            covariance = (quad.covariance_px2 + self.covariance_px2) / elapsed_s**2
        if self.velocity_px_s is not None:
            velocity = self.velocity_px_s + NEW_VELOCITY * (velocity - self.velocity_px_s)
        if covariance is not None and self.velocity_covariance is not None:
            covariance = (1.0 - NEW_VELOCITY) ** 2 * self.velocity_covariance + NEW_VELOCITY**2 * covariance
        return TrackState.from_quad(quad, now_ns)._replace(velocity_px_s=velocity, velocity_covariance=covariance)

    def forget_velocity(self) -> TrackState:
        """The state without what earlier frames say of its motion."""
        return self._replace(velocity_px_s=None, velocity_covariance=None)

    def predicted_px(self, now_ns: int) -> Floats:
        """(4, 2) the predicted corners, at constant velocity."""
        if self.velocity_px_s is None:
            return self.corners_px
        expected: Floats = self.corners_px + self.velocity_px_s * ((now_ns - self.seen_ns) * 1e-9)
        return expected


@dataclass(slots=True, eq=False)
class Track:
    """One lit square over time. All fields are records; a frame replaces them."""

    state: TrackState
    history: History
    fits: tuple[Floats, ...] = ()  # unknowns of the last ones, while it was read
    picture: PanelPicture | None = None  # that it is followed by, once there were enough
    waits: bool = False  # the frame had no time for it: the next one is to show it
    is_none: bool = False  # surely no panel: it ends with the frame

    @property
    def place(self) -> Place:
        """The square's."""
        return place_of(self.state.corners_px)


class Tracker:
    """The tracks of one stream. Call `begin_frame` for each frame, then `continue_track`, then `associate` the rest."""

    def __init__(self, specs: tuple[PanelSpec, ...], cells: int) -> None:
        self._no_frame, self._cells = History.empty(specs), cells
        self._tracks: list[Track] = []
        self._before_ns = self._now_ns = 0

    def begin_frame(self, now_ns: int) -> None:
        """Starts a frame. Tracks end after MAX_GAP_NS without their square, and all end where time does not advance."""
        self._tracks = [t for t in self._tracks if 0 < now_ns - t.state.seen_ns <= MAX_GAP_NS and not t.is_none]
        self._before_ns, self._now_ns = self._now_ns, now_ns

    def read_tracks(self) -> list[Track]:
        """The tracks of panels that were read and that this frame should show near by, the longest unseen first.

        These are what the last frame showed, or had no time for.
        """
        known = [t for t in self._tracks if t.history.identity and (t.waits or t.state.seen_ns == self._before_ns)]
        return sorted(known, key=lambda t: t.state.seen_ns)

    def unread_tracks(self) -> list[Track]:
        """The tracks of other squares, which may become panels: of the last frame, or it had no time for them.

        The longest unseen first, and of those the newest.

        A square that overlaps a panel is a part of it, or its surroundings. One that many frames have shown without a
        reading is a lamp or a window.
        """
        seen = [t for t in self._tracks if t.history.identity and t.state.seen_ns == self._now_ns]
        self._tracks = [t for t in self._tracks if t in seen or not any(overlap(t.place, p.place) for p in seen)]
        others = [t for t in self._tracks if not t.history.identity and (t.waits or t.state.seen_ns == self._before_ns)]
        followed = [t for t in reversed(others) if t.history.frames < FOLLOWED_FRAMES.get(t.history.state, math.inf)]
        return sorted(followed, key=lambda t: t.state.seen_ns)

    def continue_track(self, track: Track, quad: Quad | Rejected) -> Quad | None:
        """The quad that was fitted at the track's prediction, in the track's order; None if it cannot be the track's.

        If it is another track's in this frame, the two have merged, and this one ends.
        """
        if isinstance(quad, Rejected) or _distance(quad, track, self._now_ns) is None:
            return None
        if quad.residual > WORSE * track.state.residual:
            return None
        (centre, side), seen = place_of(quad.corners_px), [t for t in self._tracks if t.state.seen_ns == self._now_ns]
        if any(math.dist(centre, at) < SAME * side > abs(side - of) for at, of in (t.place for t in seen)):
            self._tracks.remove(track)
            return None
        return self._update(track, quad)

    def panels_shown(self) -> list[bool]:
        """For each panel that was read, and had its turn, whether this frame has shown it."""
        return [t.state.seen_ns == self._now_ns for t in self._tracks if t.history.identity and not t.waits]

    def missing_px(self) -> list[Floats]:
        """(4, 2) each, the predicted corners of the panels that were read and that this frame has not shown."""
        unseen = [t for t in self._tracks if t.history.last is not None and t.state.seen_ns != self._now_ns]
        return [t.state.predicted_px(self._now_ns) for t in unseen]

    def is_followed(self, corners_px: Floats, within: float = SAME_CELLS) -> bool:
        """Tells whether a square with these corners (4, 2) belongs to a track that this frame has shown, or that waits.

        There is no second panel where one was read. A square that was not read may be a part of a panel, or more than
        it: it excludes only squares whose corners are no further apart than `within`, in cells.
        """
        place, corners = place_of(corners_px), corners_px.tolist()
        same = within / self._cells
        return any(
            (t.history.identity is not None and overlap(place, t.place))
            or corners_apart(corners, t.state.corners_px.tolist()) < same * t.place[1]
            for t in self._tracks
            if t.waits or t.state.seen_ns == self._now_ns
        )

    def associate(self, quad: Quad) -> tuple[Quad, Track] | None:
        """Data association: the nearest track that the quad continues, or one that it begins; its corners in its order.

        None for what this frame has shown before. Panels hide what is behind them, so of two squares about one middle
        that stays which leaves less; but a smaller one drops no larger one, as each of a panel's cells is even.
        """
        place = place_of(quad.corners_px)
        rivals = [t for t in self._tracks if t.state.seen_ns == self._now_ns and overlap(place, t.place)]
        at_most, at_least = place[1] * MAX_GROWTH, place[1] / MAX_GROWTH
        is_beaten = any(t.place[1] > at_least and quad.residual >= t.state.residual for t in rivals)
        if self.is_followed(quad.corners_px) or is_beaten:
            return None
        beaten = [t for t in rivals if t.place[1] < at_most and quad.residual < t.state.residual]
        self._tracks = [t for t in self._tracks if t not in beaten]
        unseen = [t for t in self._tracks if t.state.seen_ns != self._now_ns]
        apart = [(distance, t) for t in unseen if (distance := _distance(quad, t, self._now_ns)) is not None]
        if apart:
            _, track = min(apart, key=lambda pair: pair[0])
            return self._update(track, quad), track
        track = Track(TrackState.from_quad(quad, self._now_ns), self._no_frame)
        self._tracks.append(track)
        return quad, track

    def _update(self, track: Track, quad: Quad) -> Quad:
        """The quad in the track's order, once the track's state has it."""
        quad = _align_corners(quad, track.state.corners_px)
        track.state = track.state.update(quad, self._now_ns)
        return quad


def overlap(one: Place, other: Place) -> bool:
    return math.dist(one[0], other[0]) < OVERLAP * max(one[1], other[1])


def place_of(corners_px: Floats) -> Place:
    corners = corners_px.tolist()
    return quad_middle(corners), quad_side(corners)


def _distance(quad: Quad, track: Track, now_ns: int) -> float | None:
    """Distance from a quad to a track's prediction, in sides; None outside the association gate."""
    corners, before = quad.corners_px.tolist(), track.state.corners_px.tolist()
    side, was = quad_side(corners), quad_side(before)
    distance = math.dist(quad_middle(corners), quad_middle(track.state.predicted_px(now_ns).tolist())) / side
    if not (distance < MAX_SHIFT and 1 / MAX_GROWTH < side / was < MAX_GROWTH):
        return None
    return distance if corners_apart(_shape(corners, side), _shape(before, was)) < MAX_RESHAPED else None


def _shape(corners: list[list[float]], side: float) -> list[tuple[float, float]]:
    """Corners about their centre, in sides."""
    x, y = quad_middle(corners)
    return [((a - x) / side, (b - y) / side) for a, b in corners]


def _align_corners(quad: Quad, before_px: Floats) -> Quad:
    """The quad with its corners rotated so that each continues the track's."""
    corners, before = (
        np.ascontiguousarray(at).view(np.complex128)[:, 0].tolist() for at in (quad.corners_px, before_px)
    )
    middle = sum(before) / 4
    towards = [(at - middle).conjugate() for at in before]
    turned = [math.fsum((towards[i] * corners[i - 4 + k]).real for i in range(4)) for k in range(4)]
    turns = turned.index(max(turned))
    if turns == 0:
        return quad
    parts = quad.lattice_px, quad.hidden
    lattice, hidden = (None if part is None else np.roll(part, -turns, axis=0) for part in parts)
    corners_px, covariance = np.roll(quad.corners_px, -turns, axis=0), quad.covariance_px2
    if covariance is not None:
        covariance = np.roll(covariance, (-2 * turns, -2 * turns), axis=(0, 1))
    unknown = None if quad.unknown is None else turned_unknown(quad.unknown, turns)
    return replace(
        quad, corners_px=corners_px, covariance_px2=covariance, lattice_px=lattice, hidden=hidden, unknown=unknown
    )
