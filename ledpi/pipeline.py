"""The path of one frame: find → edges → cells → identify → pose. The only module that knows all stages."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import TypeAlias

from ledpi.config import Method, PanelSettings
from ledpi.decode.bands import NO_SQUARE, BandsReader
from ledpi.decode.cells import CellSamples, sample_cells
from ledpi.decode.finding.find import Candidate
from ledpi.decode.identify import soft
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.reader import Reader
from ledpi.decode.squares import Squares
from ledpi.decode.track import NOT_SHOWN, Track, Tracker
from ledpi.dictionaries import load_dictionary
from ledpi.markers import corners_of_turned
from ledpi.pose.fix import Robot
from ledpi.pose.place import Placer
from ledpi.records import (
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
from ledpi.results import Results
from ledpi.row_clock import MIN_DEVIATION, RowClock
from ledpi.search_plan import SearchPlan
from ledpi.trace import Look, Trace

STAGES: dict[Method, tuple[str, ...]] = {
    "soft": ("find", "edges", "cells", "soft", "pose"),
    "bands": ("bands", "pose"),
}

_Looked: TypeAlias = tuple[Quad, Track, CellSamples]
_Find: TypeAlias = Callable[[Frame], tuple[list[Candidate], list[Rejected]]]


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
        self._reader = Reader(codebooks, soft.FALSE_ID_RATE)
        self._readers = [BandsReader(dictionary, ids, spec) for spec, ids in groups] if method == "bands" else []
        self._specs = tuple(spec for spec, _ in groups)
        self._squares = Squares(camera, self._cells, self._specs, intrinsics)
        sides_m = {marker_id: panels.spec(marker_id).side_m for marker_id in range(len(dictionary.words))}
        self._placer = Placer(intrinsics, sides_m, stream=stream, robot=robot)
        self._tracker = Tracker(self._specs)
        self._plan = SearchPlan(stream=stream)
        self._row_clock = RowClock(camera)
        self.off_frequency: dict[int, PanelSpec] = {}  # by ID: panels that blink at others than announced, and at which

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
        for sightings in groups(frame, work):
            if sightings:
                start = time.perf_counter()
                markers = work.add(frame, sightings, self._placer)
                self._timed(work, "pose", start)
                at_once(work.news(frame, markers))
        return work.whole(frame)

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
        """find → edges → track → cells → soft, which is the likeliest word of all cells together.

        First the panels that the frames before have shown, where they are expected; then all else.
        """
        if not self._stream:
            self._tracker = Tracker(self._specs)
        self._tracker.begin(frame.row0_readout_ns)
        looked = self._sample(frame, self._where_expected(frame, work), work)
        searching = self._plan.begins(all_seen=self._tracker.all_seen())
        others = [look for look in looked if look[1].history.shown is None]
        yield self._read(frame, [look for look in looked if look[1].history.shown is not None], work)
        found = self._search(frame, self._squares.candidates, work) if searching else []
        yield self._read(frame, others + found, work)
        looked += found
        if self._stream:
            self._keep_up(frame, looked, work)

    def _where_expected(self, frame: Frame, work: Results) -> list[tuple[Quad, Track]]:
        """The squares that are where their tracks lead; what is not there is left to a search."""
        start = time.perf_counter()
        tracks = self._tracker.expected()
        if not tracks:
            return []
        quads = self._squares.near(frame, [t.where.expected_px(frame.row0_readout_ns) for t in tracks])
        followed = [
            (there, track)
            for track, quad in zip(tracks, quads, strict=True)
            if (there := self._tracker.go_on(track, quad)) is not None
        ]
        self._timed(work, "edges", start)
        return followed

    def _search(self, frame: Frame, find: _Find, work: Results) -> list[_Looked]:
        """The squares in the whole picture, but for those that this frame has shown already, and the light in them."""
        start = time.perf_counter()
        candidates, dropped = find(frame)
        candidates = [c for c in candidates if not self._tracker.is_followed(c.corners, c.tolerance_px)]
        work.rejected.extend(dropped)
        if work.trace is not None:
            work.trace.candidates.extend(candidates)
        since = self._timed(work, "find", start)
        results = self._squares.of(frame, candidates)
        self._timed(work, "edges", since)
        for sought, quad in results:
            if isinstance(quad, Rejected):
                work.reject(sought, quad)
        return self._sample(frame, self._tracker.follow([q for _, q in results if isinstance(q, Quad)]), work)

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

    def _sample(self, frame: Frame, squares: list[tuple[Quad, Track]], work: Results) -> list[_Looked]:
        """The light in their cells, of those where it can be told."""
        since = time.perf_counter()
        looked = []
        for quad, track in squares:
            samples = sample_cells(frame, quad, self._cells, self._intrinsics, like=track.history.memories[0].lattice)
            if isinstance(samples, Rejected):
                work.reject(quad.corners_px, samples)
            else:
                looked.append((quad, track, samples))
        self._timed(work, "cells", since)
        return looked

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
