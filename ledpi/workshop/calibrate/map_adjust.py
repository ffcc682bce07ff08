"""Bundle adjustment: all panels' places and all camera poses of a drive at once, from the corners. Needs scipy.

Minimises Σ ρ(|W·(seen − projected)|²) over the views' camera_from_map and the panels' map_from_marker, the origin panel
held fast. W makes the errors of a square's sides independent (`ledpi.pose.corners`); ρ is Cauchy's, so that a panel
that something stood before weighs little.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, csc_matrix, identity
from scipy.sparse.linalg import splu

from ledpi.core.lens import projected
from ledpi.core.records import Floats, Intrinsics
from ledpi.pose.corners import FLOOR_PX, whiteners
from ledpi.pose.planar import square_corners
from ledpi.pose.refine import skew, turned
from ledpi.workshop.calibrate.map_views import PanelView, View

ROUNDS = 30
CONVERGED = 1e-6  # of the cost
CAUCHY = 4.0  # times the χ² of 8 that is expected: from there on an observation's weight falls
UPRIGHT_SIGMA_RAD = math.radians(1)  # hung by eye
OUTLIER = 26.1  # χ² of 8 that chance exceeds once in 1,000 times


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Adjusted:
    """The panels' places as the whole drive has them."""

    places: dict[int, Floats]  # map_from_marker (4, 4)
    covariances: dict[int, Floats]  # (6, 6) relative to the origin panel: position, rotation about the map's axes
    cameras: list[Floats]  # map_from_camera (4, 4) of each view
    rms_px: float
    outliers: float  # share of the panels' views that the others contradict


@dataclass(slots=True, eq=False)
class _Problem:
    """N observations of P panels in V views, as arrays."""

    view: NDArray[np.int64]  # (N,)
    panel: NDArray[np.int64]  # (N,)
    squares: Floats  # (N, 4, 3)
    seen_px: Floats  # (N, 4, 2)
    whiteners: Floats  # (N, 8, 8)
    alike: float  # by how much variances are understated, as observations are not independent
    lens: Intrinsics
    fixed: int  # the origin's panel
    upright: bool

    @property
    def upright_sigma(self) -> float:
        """Returns that of an axis that hangs upright, on the scale of observations that are taken for independent."""
        return UPRIGHT_SIGMA_RAD / math.sqrt(self.alike)


@dataclass(slots=True, eq=False)
class _State:
    view_turns: Floats  # (V, 3, 3) of camera_from_map
    view_shifts: Floats  # (V, 3)
    panel_turns: Floats  # (P, 3, 3) of map_from_marker
    panel_shifts: Floats  # (P, 3)

    def moved(self, step: Floats, fixed: int) -> _State:
        """By steps (6·(V + P),) of position and rotation about fixed axes: the views' first."""
        steps = step.reshape(-1, 6)
        count = len(self.view_shifts)
        of_view, of_panel = steps[:count], steps[count:].copy()
        of_panel[fixed] = 0
        return _State(
            turned(self.view_turns, of_view[:, 3:]),
            self.view_shifts + of_view[:, :3],
            turned(self.panel_turns, of_panel[:, 3:]),
            self.panel_shifts + of_panel[:, :3],
        )


def adjust(
    views: Sequence[View],
    places: Mapping[int, Floats],
    cameras: Sequence[Floats],
    origin: int,
    sides_m: Mapping[int, float],
    lens: Intrinsics,
    *,
    upright: bool = False,
) -> Adjusted:
    """The best places, from a first guess: `places` map_from_marker by ID, `cameras` camera_from_map of each view.

    `upright`: the panels are known to hang upright, to a degree or so, which keeps a long chain from bending.
    """
    ids = sorted(places)
    problem = _problem(views, ids, origin, sides_m, lens, upright)
    state = _State(
        np.array([c[:3, :3] for c in cameras]),
        np.array([c[:3, 3] for c in cameras]),
        np.array([places[i][:3, :3] for i in ids]),
        np.array([places[i][:3, 3] for i in ids]),
    )
    left, off_px, slopes = _linearise(problem, state)
    damping = 1e-4
    for _ in range(ROUNDS):
        weights = _weights(left)
        normal, pull = _normal(problem, state, left, slopes, weights)
        step = splu((normal + damping * _diagonal(normal)).tocsc()).solve(pull)
        tried = state.moved(step, problem.fixed)
        linearised = _linearise(problem, tried)
        gain = _cost(left) + _lean(problem, state) - _cost(linearised[0]) - _lean(problem, tried)
        if gain > 0:
            state, (left, off_px, slopes) = tried, linearised
            damping *= 0.2
            if gain < CONVERGED * _cost(left):
                break
        else:
            damping = max(10 * damping, 1e-6)
    return _result(problem, state, left, off_px, slopes, ids)


def _problem(
    views: Sequence[View],
    ids: Sequence[int],
    origin: int,
    sides_m: Mapping[int, float],
    lens: Intrinsics,
    upright: bool,
) -> _Problem:
    seen = [(v, panel) for v, view in enumerate(views) for panel in view]
    corners = np.array([panel.corners_px for _, panel in seen])
    covariances_px2 = np.array([panel.covariance_px2 for _, panel in seen])
    return _Problem(
        view=np.array([v for v, _ in seen]),
        panel=np.array([ids.index(panel.id) for _, panel in seen]),
        squares=np.array([square_corners(sides_m[panel.id]) for _, panel in seen]),
        seen_px=corners,
        whiteners=whiteners(covariances_px2),
        alike=_alike(views, seen, corners, covariances_px2),
        lens=lens,
        fixed=ids.index(origin),
        upright=upright,
    )


def _alike(
    views: Sequence[View], seen: Sequence[tuple[int, PanelView]], corners_px: Floats, covariances_px2: Floats
) -> float:
    """By how much variances of places are understated if all observations are taken for independent.

    What the fit does not show of an error, and that of the size, is alike in the n frames that show the same panels:
    their mean has the variance σ²/n + floor², where independent ones would have (σ² + floor²)/n.
    """
    groups = [frozenset(panel.id for panel in view) for view in views]
    sizes = Counter(groups)
    n = np.array([sizes[groups[v]] for v, _ in seen])
    outward = (corners_px - corners_px.mean(axis=1, keepdims=True)).reshape(-1, 8)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    size2 = np.einsum("ni,nij,nj->n", outward, covariances_px2, outward)
    noise, hidden = np.trace(covariances_px2, axis1=1, axis2=2) - size2, 8 * FLOOR_PX**2 + size2
    return float(np.mean((noise + n * hidden) / (noise + hidden)))


def _linearise(problem: _Problem, state: _State) -> tuple[Floats, Floats, Floats]:
    """Residuals whitened (N, 8) and in pixels (N, 4, 2); slopes (N, 8, 12) by the view's step and the panel's."""
    to_camera, panel_turns = state.view_turns[problem.view], state.panel_turns[problem.panel]
    arms = problem.squares @ panel_turns.transpose(0, 2, 1)  # of the corners about the panel's centre, in the map
    in_map = arms + state.panel_shifts[problem.panel][:, None]
    turned_points = in_map @ to_camera.transpose(0, 2, 1)
    pixels, by_point = projected(turned_points + state.view_shifts[problem.view][:, None], problem.lens)
    by_map_point = by_point @ to_camera[:, None]
    slopes = [by_point, -by_point @ skew(turned_points), by_map_point, -by_map_point @ skew(arms)]
    off_px = problem.seen_px - pixels
    left = problem.whiteners @ off_px.reshape(-1, 8, 1)
    whitened = problem.whiteners @ np.concatenate(slopes, axis=-1).reshape(-1, 8, 12)
    return left[..., 0], off_px, whitened


def _chi2(left: Floats) -> Floats:
    return np.asarray((left * left).sum(axis=1))


def _cost(left: Floats) -> float:
    scale = 8 * CAUCHY
    return float(scale * np.log1p(_chi2(left) / scale).sum())


def _weights(left: Floats) -> Floats:
    return 1.0 / (1.0 + _chi2(left) / (8 * CAUCHY))


def _normal(
    problem: _Problem, state: _State, left: Floats, slopes: Floats, weights: Floats
) -> tuple[csc_matrix, Floats]:
    """JᵀJ, sparse, and Jᵀr; the origin panel's rows and columns are those of the identity."""
    count = len(state.view_shifts) + len(state.panel_shifts)
    rows = np.repeat(np.arange(8 * len(left)).reshape(-1, 8, 1), 12, axis=2)
    blocks = np.stack([problem.view, len(state.view_shifts) + problem.panel], axis=1)
    columns = np.repeat((6 * blocks[:, :, None] + np.arange(6)).reshape(-1, 1, 12), 8, axis=1)
    root = np.sqrt(weights)[:, None, None]
    values = slopes * root
    values[problem.panel == problem.fixed, :, 6:] = 0
    jacobian = csc_matrix((values.ravel(), (rows.ravel(), columns.ravel())), shape=(8 * len(left), 6 * count))
    held = np.zeros(6 * count)
    held[6 * (len(state.view_shifts) + problem.fixed) :][:6] = 1.0
    normal = (jacobian.T @ jacobian + identity(6 * count, format="csc").multiply(held[:, None])).tocsc()
    pull = np.asarray(jacobian.T @ (left * root[..., 0]).ravel())
    if not problem.upright:
        return normal, pull
    # A small turn ω moves an axis a by ω × a.
    slopes = -skew(state.panel_turns[:, :, 1])[:, :2] / problem.upright_sigma
    slopes[problem.fixed] = 0
    leaning = np.zeros((count, 6, 6))
    leaning[len(state.view_shifts) :, 3:, 3:] = slopes.transpose(0, 2, 1) @ slopes
    off = -state.panel_turns[:, :2, 1, None] / problem.upright_sigma
    pull.reshape(count, 6)[len(state.view_shifts) :, 3:] += (slopes.transpose(0, 2, 1) @ off)[..., 0]
    return (normal + block_diag([csc_matrix(block) for block in leaning], format="csc")).tocsc(), pull


def _lean(problem: _Problem, state: _State) -> float:
    """χ² of the panels' leaning: the horizontal parts of their y axes."""
    return float(np.square(state.panel_turns[:, :2, 1] / problem.upright_sigma).sum()) if problem.upright else 0.0


def _diagonal(normal: csc_matrix) -> csc_matrix:
    return identity(normal.shape[0], format="csc").multiply(normal.diagonal()[:, None]).tocsc()


def _result(
    problem: _Problem, state: _State, left: Floats, off_px: Floats, slopes: Floats, ids: Sequence[int]
) -> Adjusted:
    """Covariances from the inverse of the normal matrix, times what the residuals are larger than they should be."""
    weights = _weights(left)
    normal, _ = _normal(problem, state, left, slopes, weights)
    solver, views = splu(normal), len(state.view_shifts)
    freedom = max(1, left.size - 6 * (views + len(ids) - 1))
    scale = max(1.0, float((weights * _chi2(left)).sum()) / freedom)
    scale_all = scale * problem.alike
    covariances = {}
    for k, marker_id in enumerate(ids):
        first = 6 * (views + k)
        unit = np.zeros((normal.shape[0], 6))
        unit[first : first + 6] = np.eye(6)
        covariance = scale_all * solver.solve(unit)[first : first + 6]
        covariances[marker_id] = np.zeros((6, 6)) if k == problem.fixed else covariance
    places = {}
    for k, marker_id in enumerate(ids):
        places[marker_id] = np.eye(4)
        places[marker_id][:3, :3], places[marker_id][:3, 3] = state.panel_turns[k], state.panel_shifts[k]
    cameras = []
    for rotation, shift in zip(state.view_turns, state.view_shifts, strict=True):
        camera = np.eye(4)
        camera[:3, :3], camera[:3, 3] = rotation.T, -rotation.T @ shift
        cameras.append(camera)
    good = _chi2(left) < OUTLIER * scale
    return Adjusted(
        places=places,
        covariances=covariances,
        cameras=cameras,
        rms_px=float(np.sqrt(np.square(off_px[good]).sum(axis=2).mean())),
        outliers=float(1 - good.mean()),
    )
