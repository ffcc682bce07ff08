"""Views of a drive past the panels: how they hang to each other, and the first guess from that.

Only frames that show two panels or more tell anything. Each pair's relative pose is the one that its frames agree on: a
square's mirror pose is somewhere else in every frame. Pairs are chained outward from the origin panel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ledpi.core.geometry import inverse, matrix_from_quaternion, transform
from ledpi.core.records import Floats, Frame, Intrinsics, MarkerPose
from ledpi.pose.corners import centre_px, corners_at_row, whiteners
from ledpi.pose.planar import square_corners
from ledpi.pose.refine import fit_body

VIEWS_OF_A_GROUP = 40  # frames that show the same panels, evenly over the drive: more of one place add nothing
SAME_PLACE_M, SAME_ANGLE_RAD = 0.1, 0.1  # how far two frames' relative poses may differ and count as agreeing


@dataclass(frozen=True, slots=True, eq=False)
class PanelView:
    """A panel in a frame."""

    id: int
    corners_px: Floats  # (4, 2) at one moment for all panels of the frame
    covariance_px2: Floats  # (8, 8) of their x and y
    poses: tuple[Floats, ...]  # camera_from_marker (4, 4), the likelier first: one, or two where the other may be true


View = tuple[PanelView, ...]  # a frame


def view_of(frame: Frame, markers: Sequence[MarkerPose]) -> View:
    """The placed panels of a frame, brought to their mean row's time."""
    placed = [m for m in markers if m.solution is not None]
    rows = [centre_px(m.detection.corners_px)[1] for m in placed]
    row = float(np.mean(rows)) if rows else 0.0
    views = []
    for marker in placed:
        seen = marker.detection
        poses = []
        for solution in (marker.solution, marker.alternate):
            if solution is not None:
                pose = solution.camera_from_marker
                poses.append(transform(matrix_from_quaternion(pose.quaternion_wxyz), pose.position_m))
        corners = corners_at_row(seen.corners_px, seen.velocity_px_s, row, frame.row_time_us)
        views.append(PanelView(seen.id, corners, seen.covariance_px2, tuple(poses)))
    return tuple(views)


def informative_views(views: Sequence[View]) -> list[View]:
    """Those that show two panels or more, of each group of panels at most so many."""
    groups: dict[frozenset[int], list[View]] = {}
    for view in views:
        if len(view) > 1:
            groups.setdefault(frozenset(panel.id for panel in view), []).append(view)
    kept = []
    for group in groups.values():
        step = max(1.0, len(group) / VIEWS_OF_A_GROUP)
        kept += [group[int(k * step)] for k in range(int(len(group) / step))]
    return kept


def chained(views: Sequence[View], origin: int, map_from_origin: Floats) -> dict[int, Floats]:
    """map_from_marker of every panel that the views connect with the origin, by the best-seen pairs."""
    seen_together: dict[tuple[int, int], list[tuple[PanelView, PanelView]]] = {}
    for view in views:
        for a, b in combinations(sorted(view, key=lambda panel: panel.id), 2):
            seen_together.setdefault((a.id, b.id), []).append((a, b))
    between = {pair: _agreed(both) for pair, both in seen_together.items()}
    places = {origin: map_from_origin}
    while True:
        reach = [pair for pair in between if (pair[0] in places) != (pair[1] in places)]
        if not reach:
            return places
        first, second = max(reach, key=lambda pair: between[pair][1])
        relative = between[first, second][0]
        if first in places:
            places[second] = places[first] @ relative
        else:
            places[first] = places[second] @ inverse(relative)


def _agreed(seen: Sequence[tuple[PanelView, PanelView]]) -> tuple[Floats, int]:
    """a_from_b that most frames can have seen, and how many those are."""
    frames = [[inverse(p) @ q for p in a.poses for q in b.poses] for a, b in seen]
    candidates = [(k, c) for k, found in enumerate(frames) for c in found]
    best, most = candidates[0][1], (-1, 0.0)
    for _, candidate in candidates:
        nearest = [min(_apart(candidate, other) for other in found) for found in frames]
        agreeing = [distance for distance in nearest if distance < 1.0]
        score = (len(agreeing), -float(np.sum(agreeing)))
        if score > most:
            best, most = candidate, score
    return best, most[0]


def _apart(a: Floats, b: Floats) -> float:
    """Returns how far two relative poses are apart; below 1 they agree."""
    away = float(np.linalg.norm(a[:3, 3] - b[:3, 3])) / (SAME_PLACE_M + 0.05 * float(np.linalg.norm(a[:3, 3])))
    cosine = (float(np.sum(a[:3, :3] * b[:3, :3])) - 1) / 2
    return max(away, float(np.arccos(np.clip(cosine, -1, 1))) / SAME_ANGLE_RAD)


def camera_poses(
    views: Sequence[View], places: Mapping[int, Floats], sides_m: Mapping[int, float], lens: Intrinsics
) -> list[Floats]:
    """A first camera_from_map of each view: the best of those that its panels' poses lead to, by all their corners."""
    poses = []
    for view in views:
        guesses = np.array([pose @ inverse(places[panel.id]) for panel in view for pose in panel.poses])
        corners = np.array([panel.corners_px for panel in view])
        squares = [square_corners(sides_m[p.id]) @ places[p.id][:3, :3].T + places[p.id][:3, 3] for p in view]
        fits = fit_body(
            guesses[:, :3, :3],
            guesses[:, :3, 3],
            np.concatenate(squares),
            corners.reshape(-1, 2),
            whiteners(np.array([panel.covariance_px2 for panel in view])),
            lens,
            at_most=len(guesses),
        )
        best = int(np.argmin(fits.chi2))
        poses.append(transform(fits.rotations[best], fits.positions[best]))
    return poses
