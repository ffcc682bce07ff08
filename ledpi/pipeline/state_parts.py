"""The parts of a pipeline's state that are no tracks: panels, times, what was searched, what was placed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ledpi.core.records import Frame, PanelSpec, PlanarSolution, Pose
from ledpi.core.row_clock import INTERVALS, ClockState
from ledpi.decode.agenda import Agenda
from ledpi.pipeline.plain import Node
from ledpi.pose.branches import REMEMBERED, Hypothesis
from ledpi.pose.fix_history import Candidate, FixHistoryState
from ledpi.pose.place import Placed

MAX_PLACES, MAX_IDS = 65_536, 65_536  # far more than a picture can show
MAX_PX = 1e6
MAX_HZ_RATIO = 2.0  # times what is looked for: no panel's frequencies are ever sought as far off


def frame_of(node: Node) -> Frame:
    """A frame's times, without its picture."""
    return Frame(
        pixels=np.empty((0, 0), np.uint8),
        seq=node["seq"].integer(),
        row0_readout_ns=node["row0_readout_ns"].integer(),
        exposure_us=node["exposure_us"].real(0.1, 1e8),
        row_time_us=node["row_time_us"].real(0.1, 1e4),
        transfer="linear" if node["transfer"].choice("linear", "srgb") == "linear" else "srgb",
        analogue_gain=node["analogue_gain"].optional(lambda gain: gain.real(0.0)),
        host_offset_ns=0,  # of a clock that this machine has no more
    )


def spec_of(node: Node, looked_for: Sequence[PanelSpec]) -> PanelSpec:
    """A panel like one of those that are looked for, its frequencies perhaps a little others."""
    phase = node["phase"].choice("free", "antiphase")
    spec = PanelSpec(
        side_m=node["side_m"].real(1e-3, 1e3),
        black_hz=node["black_hz"].real(1.0, 1e6),
        white_hz=node["white_hz"].real(1.0, 1e6),
        duty=node["duty"].real(1e-3, 1.0 - 1e-3),
        phase="free" if phase == "free" else "antiphase",
    )
    for like in looked_for:
        if spec == like:
            return like  # the very one: where a memory has that, no codebook is made anew
        if spec.phase == like.phase and all(map(_is_near, spec.waves_hz, like.waves_hz)):
            return spec
    raise ValueError(
        f"{node.path}: is of {spec.blinking()}, and {' or '.join(s.blinking() for s in looked_for)} is looked for; "
        "must be decoded with the configuration that it was taken with"
    )


def _is_near(one_hz: float, other_hz: float) -> bool:
    return 1.0 / MAX_HZ_RATIO < one_hz / other_hz < MAX_HZ_RATIO


def agenda_of(node: Node) -> Agenda:
    """What was searched."""
    turns = node["turns"].array(np.int64, None, max_abs=MAX_PLACES)
    turn = node["turn"].integer()
    return Agenda(
        since_search=node["since_search"].integer(),
        turn=turn,
        middles=node["middles"].array(np.float64, len(turns), 2, max_abs=MAX_PX),
        turns=turns,
    )


def clock_of(node: Node) -> ClockState:
    """What the frames' times have told."""
    return ClockState(
        ratios=tuple(each.real(0.5, 2.0) for each in node["ratios"].items(INTERVALS)),
        last=node["last"].optional(lambda last: last.pair(lambda each: each.integer())),
        ratio=node["ratio"].real(0.5, 2.0),
    )


def placed_of(node: Node) -> Placed:
    """What was placed."""
    past = node["fix_history"]
    return Placed(
        hypotheses=tuple(
            (pair[0].integer(MAX_IDS), _hypothesis(pair[1])) for pair in node["hypotheses"].pairs(MAX_IDS)
        ),
        fix_history=FixHistoryState(last=past["last"].optional(_candidate), at_ns=past["at_ns"].integer()),
    )


def _hypothesis(node: Node) -> Hypothesis:
    return Hypothesis(
        preferred=_solution(node["preferred"]),
        other=_solution(node["other"]),
        gap=node["gap"].real(),
        frames=node["frames"].integer(REMEMBERED),
        seen_ns=node["seen_ns"].integer(),
    )


def _solution(node: Node) -> PlanarSolution:
    pose = node["camera_from_marker"]
    return PlanarSolution(
        camera_from_marker=Pose(
            position_m=pose["position_m"].array(np.float64, 3),
            quaternion_wxyz=pose["quaternion_wxyz"].array(np.float64, 4),
            covariance=pose["covariance"].optional(lambda covariance: covariance.array(np.float64, 6, 6)),
        ),
        reprojection_px=node["reprojection_px"].real(),
        chi2=node["chi2"].real(),
    )


def _candidate(node: Node) -> Candidate:
    return Candidate(
        map_from_base=node["map_from_base"].array(np.float64, 4, 4),
        covariance=node["covariance"].array(np.float64, 6, 6),
        used=tuple(each.integer(MAX_IDS) for each in node["used"].items(MAX_IDS)),
        rejected=tuple(each.integer(MAX_IDS) for each in node["rejected"].items(MAX_IDS)),
    )
