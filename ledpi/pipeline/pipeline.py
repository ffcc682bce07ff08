"""The path of one frame: find → fit → cells → identify → pose. The only module that knows all stages."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import TypeAlias

from ledpi.config.settings import Method, PanelSettings
from ledpi.core.records import (
    CameraInfo,
    Decoded,
    Frame,
    Intrinsics,
    PanelSpec,
    PanelValues,
    Quad,
    Rejected,
    Sighting,
    read_only,
)
from ledpi.core.row_clock import MIN_DEVIATION, RowClock
from ledpi.decode.agenda import Agenda
from ledpi.decode.bands import NO_SQUARE, BandsReader
from ledpi.decode.cells import CellSamples, sample_cells
from ledpi.decode.identify import soft
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.locate import Locator
from ledpi.decode.proposals import Candidate, Proposer
from ledpi.decode.reader import Reader
from ledpi.decode.track import NOT_SHOWN, Track, Tracker
from ledpi.markers.dictionaries import load_dictionary
from ledpi.markers.words import corners_of_turned
from ledpi.pipeline.results import Results
from ledpi.pipeline.state import PipelineState
from ledpi.pipeline.trace import Look, Trace
from ledpi.pose.fix import Robot
from ledpi.pose.place import Placer

STAGES: dict[Method, tuple[str, ...]] = {
    "soft": ("find", "fit", "cells", "soft", "pose"),
    "bands": ("bands", "pose"),
}

# What a frame may spend on all but panels that are followed, in places at which the model is compared with the picture
# (a quarter of a microsecond each on a PC, half a candidate to 5,000): about a frame period in a stream, which takes up
# in the next frame what is left; no more is to come where a frame is alone.
STREAM_BUDGET, SINGLE_BUDGET = 150_000, 1_000_000

NOT_EXISTING = Rejected(stage="soft", reason="id_not_in_panels_ids")  # or one that a part of another panel can show

_Looked: TypeAlias = tuple[Quad, Track, CellSamples]


class Pipeline:
    """Decodes the frames of one camera. Not shared between threads.

    `stream`: frames follow each other in time, and tracks add to what a frame shows; else each frame is alone, as it
    always is for the method `bands`. `shown`: what a recording says of its own panels, which overrides `panels`.
    `robot`: how the camera sits on it, and its map; without, no fix is solved. Raises ConfigError where `panels`
    contradict what is shown.
    """

    def __init__(
        self,
        camera: CameraInfo,
        panels: PanelSettings,
        *,
        intrinsics: Intrinsics | None,
        shown: PanelValues | None = None,
        robot: Robot | None = None,
        method: Method = "soft",
        stream: bool = True,
    ) -> None:
        self._panels = panels = panels if shown is None else panels.shown_by(shown)
        self._intrinsics = intrinsics
        self._method: Method = method
        self._stream = stream
        self._cells = load_dictionary(panels.dictionary).cells_per_side
        dictionary, groups = load_dictionary(panels.dictionary), _same_frequencies(panels)
        codebooks = [Codebook.build(ids, dictionary, spec) for spec, ids in groups]
        self._reader = Reader(codebooks, soft.FALSE_ID_RATE, search_frequencies=panels.search_frequencies)
        self._readers = [BandsReader(dictionary, ids, spec) for spec, ids in groups] if method == "bands" else []
        self._specs = tuple(spec for spec, _ in groups)
        self._existing = panels.existing_ids()
        self._proposer = Proposer(camera, self._cells, self._specs)
        self._locator = Locator(self._cells, self._specs, intrinsics, must_blink=not panels.search_frequencies)
        sides_m = {marker_id: panels.spec(marker_id).side_m for marker_id in range(len(dictionary.words))}
        self._placer = Placer(intrinsics, sides_m, stream=stream, robot=robot)
        self._tracker = Tracker(self._specs)
        self._agenda = Agenda()
        self.search_budget = STREAM_BUDGET if stream else SINGLE_BUDGET
        self._row_clock = RowClock(camera)
        self.off_frequency: dict[int, PanelSpec] = {}  # by ID: panels that blink at others than announced, and at which

    def state(self) -> PipelineState:
        """What `resume` goes on from, between two frames."""
        return PipelineState(
            followed=self._tracker.state(),
            agenda=self._agenda.state(),
            clock=self._row_clock.state(),
            placed=self._placer.state(),
            off_frequency=tuple(self.off_frequency.items()),
        )

    def resume(self, state: PipelineState) -> None:
        """Goes on as the one that gave this state would: of the same camera, panels, lens and map."""
        self._tracker.resume(state.followed)
        self._agenda.resume(state.agenda)
        self._row_clock.resume(state.clock)
        self._placer.resume(state.placed)
        self.off_frequency = dict(state.off_frequency)

    @property
    def specs(self) -> tuple[PanelSpec, ...]:
        """One for each kind of blinking that is looked for."""
        return self._specs

    @property
    def cells(self) -> int:
        """Along a panel's side."""
        return self._cells

    @property
    def spent(self) -> int:
        """On all fits so far, those that followed panels too, as the budget counts it."""
        return self._locator.spent

    @property
    def panels(self) -> PanelSettings:
        """The panels that are looked for: the configuration's, with what the source knows better."""
        return self._panels

    def decode(
        self, frame: Frame, trace: Trace | None = None, at_once: Callable[[Decoded], None] = lambda news: None
    ) -> Decoded:
        """Everything that this frame shows. Time in `stage_ms` is from the picture in memory to the pose.

        `at_once` is given the same piece by piece, each as soon as it is known: panels that are followed need not wait
        until the picture has been searched for others. Where further panels give another fix, that is news too.
        `trace` takes in what each step made of the frame, and each candidate that was dropped; what `find` itself drops
        has no corners yet, and is only counted.
        """
        frame = self._with_true_row_time(frame)
        work = Results(dict.fromkeys(STAGES[self._method], 0.0), trace)
        groups = self._by_soft if self._method == "soft" else self._by_bands
        for read in groups(frame, work):
            sightings = [sighting for sighting in read if self._exists(sighting, work)]
            if sightings:
                start = time.perf_counter()
                markers = work.add(frame, sightings, self._placer)
                self._timed(work, "pose", start)
                at_once(work.news(frame, markers))
        return work.whole(frame)

    def _exists(self, sighting: Sighting, work: Results) -> bool:
        """Whether there is a panel of this ID."""
        exists = sighting.id in self._existing
        if not exists:
            work.reject(sighting.corners_px, NOT_EXISTING)
        return exists

    def _with_true_row_time(self, frame: Frame) -> Frame:
        """The frame, corrected where the stream's own times say that the driver misreports its row time."""
        if not self._stream:
            return frame
        before = self._row_clock.ratio
        self._row_clock.add(frame.seq, frame.row0_readout_ns)
        if abs(self._row_clock.ratio - before) > MIN_DEVIATION:  # what was seen so far was seen in the wrong bands
            self._tracker = Tracker(self._specs)
        return self._row_clock.corrected(frame)

    def _by_soft(self, frame: Frame, work: Results) -> Iterator[list[Sighting]]:
        """propose → fit → track → cells → soft, which is the likeliest word of all cells together.

        First the panels that the frames before have shown, where they are expected. All else shares the budget.
        """
        if not self._stream:
            self._tracker, self._agenda = Tracker(self._specs), Agenda()
        self._tracker.begin(frame.row0_readout_ns)
        looked: list[_Looked] = []
        yield self._read(frame, self._follow(frame, self._tracker.panels(), looked, work), work)
        most = self._locator.spent + self.search_budget
        for track in self._tracker.others():
            if self._locator.spent >= most:
                break
            yield self._read(frame, self._follow(frame, [track], looked, work), work)
        if self._agenda.is_due(all_seen=self._tracker.all_seen()):
            for candidate in self._agenda.in_turn(self._propose(frame, work)):
                if self._locator.spent >= most:
                    break
                yield self._read(frame, self._look_at(frame, candidate, looked, work), work)
        if self._stream:
            self._keep_up(frame, looked, work)

    def _follow(self, frame: Frame, tracks: list[Track], looked: list[_Looked], work: Results) -> list[_Looked]:
        """The squares that are where their tracks lead; what is not there is left to a search."""
        start = time.perf_counter()
        followed = []
        for track in tracks:
            at = track.where.expected_px(frame.row0_readout_ns)
            known = track.where.unknown
            if track.where.velocity_px_s is None or known is None:  # how it moves is known from its second frame on
                quad = self._locator.at(frame, at)
            else:
                quad = self._locator.near(frame, at, known)
            there = self._tracker.go_on(track, quad)
            if there is not None:
                followed.append((there, track))
        self._timed(work, "fit", start)
        return self._sample(frame, followed, looked, work)

    def _propose(self, frame: Frame, work: Results) -> list[Candidate]:
        start = time.perf_counter()
        candidates, dropped = self._proposer.propose(frame, thorough=not self._stream)
        work.rejected.extend(dropped)
        if work.trace is not None:
            work.trace.candidates.extend(candidates)
        self._timed(work, "find", start)
        return candidates

    def _look_at(self, frame: Frame, candidate: Candidate, looked: list[_Looked], work: Results) -> list[_Looked]:
        """What a candidate is, where this frame has not shown that already."""
        if self._tracker.is_followed(candidate.corners_px):
            return []
        start = time.perf_counter()
        self._agenda.tried(candidate)
        quad = self._locator.at(frame, candidate.corners_px)
        self._timed(work, "fit", start)
        if isinstance(quad, Rejected):
            work.reject(candidate.corners_px, quad)
            return []
        return self._sample(frame, self._tracker.follow([quad]), looked, work)

    def _by_bands(self, frame: Frame, work: Results) -> Iterator[list[Sighting]]:
        """The source paper's method, once for each pair of frequencies."""
        start = time.perf_counter()
        sightings = []
        for reader in self._readers:
            steps = reader.read(frame)
            if work.trace is not None:
                work.trace.bands.append(steps)
            if not steps.squares:
                work.rejected.append(NO_SQUARE)
            for square in steps.squares:
                if isinstance(square.result, Sighting):
                    sightings.append(square.result)
                else:
                    work.reject(square.corners_px, square.result)
        self._timed(work, "bands", start)
        yield sightings

    def _timed(self, work: Results, stage: str, since: float) -> float:
        now = time.perf_counter()
        work.seconds[stage] += now - since
        return now

    def _sample(
        self, frame: Frame, squares: list[tuple[Quad, Track]], looked: list[_Looked], work: Results
    ) -> list[_Looked]:
        """The light in their cells, of those where it can be told; also added to `looked`, all of this frame."""
        since = time.perf_counter()
        sampled = []
        for quad, track in squares:
            samples = sample_cells(frame, quad, self._cells, self._intrinsics, like=track.history.memories[0].lattice)
            if isinstance(samples, Rejected):
                work.reject(quad.corners_px, samples)
            else:
                sampled.append((quad, track, samples))
        looked += sampled
        self._timed(work, "cells", since)
        return sampled

    def _read(self, frame: Frame, looked: list[_Looked], work: Results) -> list[Sighting]:
        """The panels that these lit squares are; where none can be told, why is in `work`."""
        if not looked:
            return []
        since = time.perf_counter()
        sightings, times = [], frame.without_picture()
        for quad, track, samples in looked:
            outcome = self._reader.read(track.history, samples, times)
            track.history = outcome.history
            if outcome.denied:
                work.reject(quad.corners_px, NOT_SHOWN)
            if work.trace is not None:
                work.trace.looks.append(Look.of(quad, samples, outcome))
            if isinstance(outcome.shown, Rejected):
                work.reject(quad.corners_px, outcome.shown)
                continue
            sightings.append(self._sighting(quad, outcome.shown.reading, track))
        self._timed(work, "soft", since)
        return sightings

    def _sighting(self, quad: Quad, reading: soft.Reading, track: Track) -> Sighting:
        tuned, velocity = track.history.tuning.found, track.where.velocity_px_s
        if tuned is not None and tuned.measured:
            self.off_frequency[reading.id] = tuned.spec
        return Sighting(
            id=reading.id,
            corners_px=read_only(corners_of_turned(quad.corners_px, reading.quarter_turns)),
            corner_sigma_px=quad.corner_sigma_px,
            size_sigma_px=quad.size_sigma_px,
            margin=reading.margin,
            frames_used=track.history.frames,
            velocity_px_s=None if velocity is None else read_only(corners_of_turned(velocity, reading.quarter_turns)),
        )

    def _keep_up(self, frame: Frame, looked: list[_Looked], work: Results) -> None:
        """What prepares for the frames to come."""
        since, times = time.perf_counter(), frame.without_picture()
        for _, track, samples in looked:
            track.history = self._reader.keep_up(track.history, samples, times)
        self._timed(work, "soft", since)


def _same_frequencies(panels: PanelSettings) -> list[tuple[PanelSpec, list[int]]]:
    """The panel and the IDs of each kind of blinking that there is."""
    groups: dict[tuple[tuple[float, ...], float], tuple[PanelSpec, list[int]]] = {}
    for marker_id in range(len(load_dictionary(panels.dictionary).words)):
        spec = panels.spec(marker_id)
        groups.setdefault((spec.waves_hz, spec.duty), (spec, []))[1].append(marker_id)
    return list(groups.values())
