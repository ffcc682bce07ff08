"""The path of one frame: find → fit → cells → identify → pose. The only module that knows all stages."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import TypeAlias

from ledpi.config.settings import Method, PanelSettings
from ledpi.core.records import (
    CameraInfo,
    Decoded,
    Detection,
    Frame,
    Intrinsics,
    PanelSpec,
    PanelValues,
    Quad,
    Rejected,
    read_only,
)
from ledpi.core.row_clock import MIN_DEVIATION, RowClock
from ledpi.decode.agenda import Agenda
from ledpi.decode.cells import CellSamples, sample_cells
from ledpi.decode.identify import decision
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.locate import Locator
from ledpi.decode.proposals import Candidate, Proposer
from ledpi.decode.reader import Reader
from ledpi.decode.track import CONTRADICTED, Track, Tracker
from ledpi.markers.codewords import corners_of_turned, covariance_of_turned
from ledpi.markers.dictionaries import load_dictionary
from ledpi.pipeline.results import Results
from ledpi.pipeline.state import PipelineState
from ledpi.pipeline.trace import SquareTrace, Trace
from ledpi.pose.fix import Robot
from ledpi.pose.place import Placer
from ledpi.uemura.reader import NO_SQUARE, UemuraReader

STAGES: dict[Method, tuple[str, ...]] = {
    "likelihood": ("find", "fit", "cells", "identify", "pose"),
    "uemura": ("uemura", "pose"),
}

# What a frame may spend on all but panels that are followed, in places at which the model is compared with the picture
# (a quarter of a microsecond each on a PC, half a candidate to 5,000): about a frame period in a stream, which takes up
# in the next frame what is left; no more is to come where a frame is alone.
STREAM_BUDGET, SINGLE_BUDGET = 150_000, 1_000_000

NOT_EXISTING = Rejected(stage="identify", reason="id_not_in_panels_ids")  # or one that a part of another panel can show

_Sampled: TypeAlias = tuple[Quad, Track, CellSamples]


class Pipeline:
    """Decodes the frames of one camera. Not shared between threads.

    `stream`: frames follow each other in time, and tracks add to what a frame shows; else each frame is alone, as it
    always is for the method `bands`. `source_panel`: what a recording says of its own panels, which overrides `panels`.
    `robot`: how the camera sits on it, and its map; without, no fix is solved. Raises ConfigError where `panels`
    contradict what is shown.
    """

    def __init__(
        self,
        camera: CameraInfo,
        panels: PanelSettings,
        *,
        intrinsics: Intrinsics | None,
        source_panel: PanelValues | None = None,
        robot: Robot | None = None,
        method: Method = "likelihood",
        stream: bool = True,
    ) -> None:
        self._panels = panels = panels if source_panel is None else panels.override_with(source_panel)
        self._intrinsics = intrinsics
        self._method: Method = method
        self._stream = stream
        self._cells = load_dictionary(panels.dictionary).cells_per_side
        dictionary, groups = load_dictionary(panels.dictionary), _same_frequencies(panels)
        codebooks = [Codebook.build(ids, dictionary, spec) for spec, ids in groups]
        self._reader = Reader(codebooks, decision.FALSE_ID_RATE, search_frequencies=panels.search_frequencies)
        self._readers = [UemuraReader(dictionary, ids, spec) for spec, ids in groups] if method == "uemura" else []
        self._specs = tuple(spec for spec, _ in groups)
        self._existing = panels.existing_ids()
        self._proposer = Proposer(camera, self._cells, self._specs)
        self._locator = Locator(self._cells, self._specs, intrinsics, must_blink=not panels.search_frequencies)
        sides_m = {marker_id: panels.spec(marker_id).side_m for marker_id in range(len(dictionary.codewords))}
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
        """The panels that are searched for: the configuration's, overridden by what the source says."""
        return self._panels

    def decode(
        self, frame: Frame, trace: Trace | None = None, on_partial: Callable[[Decoded], None] = lambda partial: None
    ) -> Decoded:
        """Everything that this frame shows. Time in `stage_ms` is from the picture in memory to the pose.

        `on_partial` gets the same piece by piece, each as soon as it is known: tracked panels need not wait until the
        picture has been searched for others. If further panels change the fix, it is sent again. `trace` records what
        each step made of the frame, and each candidate that was dropped; what `find` itself drops has no corners yet,
        and is only counted.
        """
        frame = self._correct_row_time(frame)
        work = Results(dict.fromkeys(STAGES[self._method], 0.0), trace)
        groups = self._read_likelihood if self._method == "likelihood" else self._read_uemura
        for read in groups(frame, work):
            detections = [detection for detection in read if self._exists(detection, work)]
            if detections:
                start = time.perf_counter()
                markers = work.add(frame, detections, self._placer)
                self._timed(work, "pose", start)
                on_partial(work.partial_result(frame, markers))
        return work.final_result(frame)

    def _exists(self, detection: Detection, work: Results) -> bool:
        """Whether there is a panel of this ID."""
        exists = detection.id in self._existing
        if not exists:
            work.reject(detection.corners_px, NOT_EXISTING)
        return exists

    def _correct_row_time(self, frame: Frame) -> Frame:
        """The frame, corrected where the stream's own times say that the driver misreports its row time."""
        if not self._stream:
            return frame
        before = self._row_clock.ratio
        self._row_clock.add(frame.seq, frame.row0_readout_ns)
        if abs(self._row_clock.ratio - before) > MIN_DEVIATION:  # what was seen so far was seen in the wrong bands
            self._tracker = Tracker(self._specs)
        return self._row_clock.corrected(frame)

    def _read_likelihood(self, frame: Frame, work: Results) -> Iterator[list[Detection]]:
        """propose → fit → track → cells → identify, by the likeliest codeword of all cells together.

        Tracked panels come first, at their predicted places. All else shares the budget.
        """
        if not self._stream:
            self._tracker, self._agenda = Tracker(self._specs), Agenda()
        self._tracker.begin_frame(frame.row0_readout_ns)
        sampled_squares: list[_Sampled] = []
        yield self._identify(frame, self._follow(frame, self._tracker.read_tracks(), sampled_squares, work), work)
        most = self._locator.spent + self.search_budget
        for track in self._tracker.unread_tracks():
            if self._locator.spent >= most:
                break
            yield self._identify(frame, self._follow(frame, [track], sampled_squares, work), work)
        if self._agenda.is_due(all_detected=self._tracker.all_detected()):
            for candidate in self._agenda.schedule(self._propose(frame, work)):
                if self._locator.spent >= most:
                    break
                yield self._identify(frame, self._examine(frame, candidate, sampled_squares, work), work)
        if self._stream:
            self._prepare_next(frame, sampled_squares, work)

    def _follow(
        self, frame: Frame, tracks: list[Track], sampled_squares: list[_Sampled], work: Results
    ) -> list[_Sampled]:
        """The squares at their tracks' predictions; what is not there is left to a search."""
        start = time.perf_counter()
        followed = []
        for track in tracks:
            at = track.state.predicted_px(frame.row0_readout_ns)
            known = track.state.unknown
            if track.state.velocity_px_s is None or known is None:  # how it moves is known from its second frame on
                quad = self._locator.localise(frame, at)
            else:
                quad = self._locator.refine(frame, at, known)
            there = self._tracker.continue_track(track, quad)
            if there is not None:
                followed.append((there, track))
        self._timed(work, "fit", start)
        return self._sample(frame, followed, sampled_squares, work)

    def _propose(self, frame: Frame, work: Results) -> list[Candidate]:
        start = time.perf_counter()
        candidates, dropped = self._proposer.propose(frame, thorough=not self._stream)
        work.rejected.extend(dropped)
        if work.trace is not None:
            work.trace.candidates.extend(candidates)
        self._timed(work, "find", start)
        return candidates

    def _examine(
        self, frame: Frame, candidate: Candidate, sampled_squares: list[_Sampled], work: Results
    ) -> list[_Sampled]:
        """The square that a candidate leads to, unless this frame has already shown it."""
        if self._tracker.is_followed(candidate.corners_px):
            return []
        start = time.perf_counter()
        self._agenda.tried(candidate)
        quad = self._locator.localise(frame, candidate.corners_px)
        self._timed(work, "fit", start)
        if isinstance(quad, Rejected):
            work.reject(candidate.corners_px, quad)
            return []
        return self._sample(frame, self._tracker.associate([quad]), sampled_squares, work)

    def _read_uemura(self, frame: Frame, work: Results) -> Iterator[list[Detection]]:
        """The source paper's method, once for each pair of frequencies."""
        start = time.perf_counter()
        detections = []
        for reader in self._readers:
            steps = reader.read(frame)
            if work.trace is not None:
                work.trace.uemura.append(steps)
            if not steps.squares:
                work.rejected.append(NO_SQUARE)
            for square in steps.squares:
                if isinstance(square.result, Detection):
                    detections.append(square.result)
                else:
                    work.reject(square.corners_px, square.result)
        self._timed(work, "uemura", start)
        yield detections

    def _timed(self, work: Results, stage: str, since: float) -> float:
        now = time.perf_counter()
        work.seconds[stage] += now - since
        return now

    def _sample(
        self, frame: Frame, squares: list[tuple[Quad, Track]], sampled_squares: list[_Sampled], work: Results
    ) -> list[_Sampled]:
        """The light in the squares' cells, of those that can be sampled; they are added to `sampled_squares`, too."""
        since = time.perf_counter()
        sampled = []
        for quad, track in squares:
            samples = sample_cells(frame, quad, self._cells, self._intrinsics, like=track.history.memories[0].lattice)
            if isinstance(samples, Rejected):
                work.reject(quad.corners_px, samples)
            else:
                sampled.append((quad, track, samples))
        sampled_squares += sampled
        self._timed(work, "cells", since)
        return sampled

    def _identify(self, frame: Frame, sampled_squares: list[_Sampled], work: Results) -> list[Detection]:
        """The panels among these squares; the reasons against the others go to `work`."""
        if not sampled_squares:
            return []
        since = time.perf_counter()
        detections, times = [], frame.drop_picture()
        for quad, track, samples in sampled_squares:
            outcome = self._reader.read(track.history, samples, times)
            track.history = outcome.history
            if outcome.contradicted:
                work.reject(quad.corners_px, CONTRADICTED)
            if work.trace is not None:
                work.trace.squares.append(SquareTrace.from_outcome(quad, samples, outcome))
            if isinstance(outcome.identity, Rejected):
                work.reject(quad.corners_px, outcome.identity)
                continue
            detections.append(self._detection(quad, outcome.identity.reading, track))
        self._timed(work, "identify", since)
        return detections

    def _detection(self, quad: Quad, reading: decision.Reading, track: Track) -> Detection:
        assert quad.covariance_px2 is not None, "the localisation measures it"
        tuned, velocity = track.history.search.found, track.state.velocity_px_s
        if tuned is not None and tuned.measured:
            self.off_frequency[reading.id] = tuned.spec
        return Detection(
            id=reading.id,
            corners_px=read_only(corners_of_turned(quad.corners_px, reading.quarter_turns)),
            covariance_px2=read_only(covariance_of_turned(quad.covariance_px2, reading.quarter_turns)),
            margin=reading.margin,
            frames_used=track.history.frames,
            velocity_px_s=None if velocity is None else read_only(corners_of_turned(velocity, reading.quarter_turns)),
        )

    def _prepare_next(self, frame: Frame, sampled_squares: list[_Sampled], work: Results) -> None:
        """Work for the frames to come."""
        since, times = time.perf_counter(), frame.drop_picture()
        for _, track, samples in sampled_squares:
            track.history = self._reader.prepare_next(track.history, samples, times)
        self._timed(work, "identify", since)


def _same_frequencies(panels: PanelSettings) -> list[tuple[PanelSpec, list[int]]]:
    """The panel and the IDs of each set of frequencies and duty that there is."""
    groups: dict[tuple[tuple[float, ...], float], tuple[PanelSpec, list[int]]] = {}
    for marker_id in range(len(load_dictionary(panels.dictionary).codewords)):
        spec = panels.spec(marker_id)
        groups.setdefault((spec.waves_hz, spec.duty), (spec, []))[1].append(marker_id)
    return list(groups.values())
