"""Ranks pairs of frequencies, each with its frame period, by what they let the decoder know.

A pair is tried with the frame periods from the sensor's shortest on, until its bands' advance has taken every value;
the one that gives most a second of what the decoder needs at the farthest distance is kept. Pairs are then ordered by
how much of that they give over all distances, of one frame and of a short stream; those that at some distance would
give less than the present pair come after those that never do, and those that a given period freezes come last.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from ledpi.camera.simulate.scene import SimulatedSensor
from ledpi.camera.timing import MIN_PHASE_ADVANCE_CYCLES, choose_frame_length_rows
from ledpi.core.errors import ConfigError
from ledpi.core.records import PanelSpec, Phase, Rejected
from ledpi.core.shutter import phase_advance_cycles
from ledpi.decode.evidence.cells import MIN_CELL_PX
from ledpi.workshop.panel.frequencies import (
    NULL_SHARE,
    Flicker,
    least_amplitude,
    null_share,
    off_mains_hz,
    worthwhile_frequencies,
)
from ledpi.workshop.panel.information import STREAM_FRAMES, View, evidence_of, separation_nats, view_panel

# From so much information a cell and frame on, the decoder's decision is right in 97 draws of 100 and more; what a pair
# gives beyond counts no more. (A test draws. But for word 17 of DICT_4X4_50, which half a panel may look like, in 98.)
ENOUGH_NATS = 20.0
# Two frames that are 1/20 of a cycle apart differ by 2·sin(π/20) = 0.31 of the bands' amplitude: a tenth of the power.
FROZEN_CYCLES = 0.05
_SAME = 0.01  # of what is needed: less is no difference
_MAX_PERIODS = 30  # that are tried with a pair
# An oscillator that drifts further than this from where it is expected no longer adds to what earlier frames told.
_COHERENT_CYCLES = 0.25
_OFF_MAINS_HZ = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """The task that a panel is designed for."""

    sensor: SimulatedSensor  # its frame length is the shortest there is, or the only one
    period_given: bool  # whether it is the only one
    side_m: float
    cells: int  # along a side
    duty: float
    distances_m: tuple[float, ...]  # ascending
    tolerance: float  # of an oscillator, relative, up or down
    flicker: Flicker
    own_light: float = 1.0  # share in the panel's light; the rest is the room's, which its diffuser reflects

    def spec(self, black_hz: float, white_hz: float) -> PanelSpec:
        """The panel with such a pair; of one frequency twice, the antiphase panel."""
        phase: Phase = "antiphase" if black_hz == white_hz else "free"
        return PanelSpec(side_m=self.side_m, black_hz=black_hz, white_hz=white_hz, duty=self.duty, phase=phase)

    def depths(self, black_hz: float, white_hz: float) -> tuple[float, float]:
        """Amplitude of either class's bands, where its oscillator is off to the worse side."""
        exposure_us = self.sensor.exposure_us
        black, white = (least_amplitude(hz, exposure_us, self.tolerance, self.duty) for hz in (black_hz, white_hz))
        return self.own_light * black, self.own_light * white

    def least_apart_hz(self, black_hz: float, white_hz: float) -> float:
        """Returns how far apart two frequencies must be.

        That is more than their oscillators may be off, and than what lets them drift by a cycle over a whole picture.
        """
        scan_s = self.sensor.intrinsics.height * self.sensor.row_time_us * 1e-6
        return max(self.tolerance * (black_hz + white_hz), 1.0 / scan_s)

    def least_advance(self, black_hz: float, white_hz: float, rows: int) -> float:
        """By how many cycles a frame the slower-moving class's bands are off a whole number."""
        period_us = rows * self.sensor.row_time_us
        return min(abs(phase_advance_cycles(hz, period_us)) for hz in (black_hz, white_hz))

    def periods_in_a_cell(self, frequency_hz: float, distance_m: float) -> float:
        """Counts the periods of the bands that a cell is high, from there."""
        rows = self.sensor.intrinsics.fy * self.side_m / self.cells / distance_m
        return rows * self.sensor.row_time_us * 1e-6 * frequency_hz

    def coherent_frames(self, highest_hz: float, rows: int) -> int:
        """Frames over which the worse oscillator keeps within a quarter of a cycle of where it is expected."""
        drift_cycles = self.tolerance * highest_hz * rows * self.sensor.row_time_us * 1e-6
        return 1 + int(_COHERENT_CYCLES / max(drift_cycles, 1e-9))


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """A pair of frequencies, or one twice (antiphase), with a frame period, and the nats of a cell, by distance."""

    black_hz: float
    white_hz: float
    frame_length_rows: int
    alone: tuple[float, ...]  # of one frame
    stream: tuple[float, ...]  # of STREAM_FRAMES frames

    def worth(self) -> list[float]:
        """The share of what the decoder needs, 1 at most, in each case."""
        return [min(1.0, nats / ENOUGH_NATS) for nats in (*self.alone, *self.stream)]

    def dominates(self, other: Proposal) -> bool:
        """Tells whether there is no case in which the decoder would be better off with `other`."""
        return all(own >= others - _SAME for own, others in zip(self.worth(), other.worth(), strict=True))


def views_of(task: Task) -> list[View]:
    """Pictures from each distance. Raises ConfigError for one that is too near or too far."""
    lens = task.sensor.intrinsics
    nearest = lens.fy * task.side_m / lens.height
    if task.distances_m[0] < nearest:
        raise ConfigError(
            f"--distance {task.distances_m[0]:g}: from there a panel of {task.side_m:g} m is larger than the picture; "
            f"must be at least {nearest:.2f}"
        )
    views = []
    for distance_m in task.distances_m:
        view = view_panel(task.sensor, task.cells, task.side_m, distance_m)
        if isinstance(view, Rejected):
            farthest = farthest_m(task.sensor, task.side_m, task.cells)
            raise ConfigError(
                f"--distance {distance_m:g}: from there a panel of {task.side_m:g} m cannot be sampled ({view.key}); "
                f"must be at most {farthest:.1f}"
            )
        views.append(view)
    return views


def farthest_m(sensor: SimulatedSensor, side_m: float, cells: int) -> float:
    """From where a panel's cells are as small as the decoder takes them, and a little more to be sure."""
    return 0.98 * sensor.intrinsics.fx * side_m / cells / MIN_CELL_PX


def candidate_frequencies(task: Task) -> list[float]:
    """All frequencies worth a trial, rising."""
    exposure_us = task.sensor.exposure_us
    return [
        hz
        for hz in worthwhile_frequencies(exposure_us, task.flicker.lowest_hz)
        if null_share(hz, exposure_us, task.tolerance) >= NULL_SHARE
        and hz * task.sensor.row_time_us * 1e-6 < 0.5
        and off_mains_hz(hz) >= _OFF_MAINS_HZ
    ]


def candidate_pairs(task: Task) -> list[tuple[float, float]]:
    """All pairs worth a trial, black the slower one. Raises ConfigError where there is none."""
    exposure_us, lowest_hz = task.sensor.exposure_us, task.flicker.lowest_hz
    frequencies = candidate_frequencies(task)
    pairs = [(b, w) for b, w in itertools.combinations(frequencies, 2) if w - b > task.least_apart_hz(b, w)]
    if not pairs:
        # A lobe must be wide enough for the tolerance: ± tolerance·f·T less than about a third of a cycle.
        shorter_us = 0.3 / (max(task.tolerance, 1e-6) * lowest_hz) * 1e6
        raise ConfigError(
            f"no two frequencies from {lowest_hz:g} Hz on stay off the nulls of a {exposure_us:.0f} µs exposure where "
            f"oscillators are off by ± {1e6 * task.tolerance:g} ppm: a crystal is within ± 100 ppm; or an exposure of "
            f"at most {shorter_us:.0f} µs"
        )
    return pairs


def choose_period(task: Task, black_hz: float, white_hz: float, views: Sequence[View]) -> Proposal:
    """The pair with the frame period that tells most a second at the farthest distance."""
    shortest = task.sensor.frame_length_rows
    # Over so many rows the slower class's advance takes every value once.
    span = 0 if task.period_given else math.ceil(1e6 / (min(black_hz, white_hz) * task.sensor.row_time_us))
    far = views[-1:]

    def nats_per_s(rows: int) -> float:
        return min(1.0, _nats(task, black_hz, white_hz, far, rows, STREAM_FRAMES)[0] / ENOUGH_NATS) / rows

    periods = range(shortest, shortest + span + 1, 1 + span // _MAX_PERIODS)
    moving = [rows for rows in periods if task.least_advance(black_hz, white_hz, rows) >= MIN_PHASE_ADVANCE_CYCLES]
    rows = max(moving or periods, key=nats_per_s)
    return proposal_at(task, black_hz, white_hz, rows, views)


def antiphase_proposals(task: Task, views: Sequence[View]) -> list[Proposal]:
    """Single frequencies, each with its frame period, those first at which classes half a cycle apart tell most.

    Of equals the lowest comes first. A cell that is taken for the other class is then off by twice its bands, whatever
    the phase. Empty where the duty is not a half, so that one class would not fill the other's gaps.
    """
    frequencies = candidate_frequencies(task) if task.duty == 0.5 else []
    tried = [choose_period(task, hz, hz, views) for hz in frequencies]
    return sorted(tried, key=lambda proposal: -sum(proposal.worth()))


def auto_rows(task: Task, pair: tuple[float, float]) -> int:
    """The frame period that the daemon gives a pair, in rows; the shortest where none would keep both moving."""
    shortest = task.sensor.frame_length_rows
    if task.period_given:
        return shortest
    try:
        return choose_frame_length_rows(
            shortest_rows=shortest, row_time_us=task.sensor.row_time_us, frequencies_hz=pair
        )
    except ValueError:
        return shortest


def proposal_at(task: Task, black_hz: float, white_hz: float, rows: int, views: Sequence[View]) -> Proposal:
    """The pair with this very frame period."""
    return Proposal(
        black_hz=black_hz,
        white_hz=white_hz,
        frame_length_rows=rows,
        alone=_nats(task, black_hz, white_hz, views, rows, 1),
        stream=_nats(task, black_hz, white_hz, views, rows, STREAM_FRAMES),
    )


def _nats(
    task: Task, black_hz: float, white_hz: float, views: Sequence[View], rows: int, frames: int
) -> tuple[float, ...]:
    """Information of so many frames, as far as the oscillators let them add up, from each view."""
    spec, depths = task.spec(black_hz, white_hz), task.depths(black_hz, white_hz)
    frames = min(frames, task.coherent_frames(max(black_hz, white_hz), rows))
    evidence = (evidence_of(view, spec, frames=frames, frame_length_rows=rows) for view in views)
    return tuple(separation_nats(known, depths) for known in evidence)


def ranked(
    task: Task, present: Proposal, views: Sequence[View], advance: Callable[[int], None] = lambda count: None
) -> list[Proposal]:
    """Every pair worth a trial, the best first."""

    def tried() -> Iterator[Proposal]:
        for pair in candidate_pairs(task):
            yield choose_period(task, *pair, views)
            advance(1)

    def place(p: Proposal) -> tuple[bool, bool, float]:
        frozen = task.least_advance(p.black_hz, p.white_hz, p.frame_length_rows) < FROZEN_CYCLES
        return frozen, not p.dominates(present), -sum(p.worth())

    return sorted(tried(), key=place)
