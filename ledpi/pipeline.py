"""The path of one frame: find → edges → cells → identify → pose. The only module that knows all stages."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, fields

import numpy as np

from ledpi.config import Method, PanelSettings
from ledpi.decode import soft
from ledpi.decode.approach import approach_quads
from ledpi.decode.bands import NO_SQUARE, BandsReader
from ledpi.decode.cells import MIN_CELL_PX, sample_cells
from ledpi.decode.edges import refine_quads
from ledpi.decode.find import Finder
from ledpi.decode.reader import Reader
from ledpi.decode.rim import make_usual_filters
from ledpi.decode.sightings import one_of_each
from ledpi.decode.track import NOT_SHOWN, Track, Tracker
from ledpi.dictionaries import load_dictionary
from ledpi.markers import corners_of_turned
from ledpi.pose.fix import Robot
from ledpi.pose.place import Placer
from ledpi.records import (
    CameraInfo,
    Decoded,
    Floats,
    Frame,
    Intrinsics,
    MarkerPose,
    PanelSpec,
    PanelValues,
    Quad,
    Rejected,
    RobotFix,
    Sighting,
    read_only,
)
from ledpi.row_clock import MIN_DEVIATION, RowClock
from ledpi.trace import Dropped, Look, Trace

# A stream searches the whole picture for newcomers in every third frame, and in each that does not show all its tracks.
SEARCH_EVERY = 3
STAGES: dict[Method, tuple[str, ...]] = {
    "soft": ("find", "edges", "cells", "soft", "pose"),
    "bands": ("bands", "pose"),
}


@dataclass(slots=True)
class _Work:
    """What one frame has given so far."""

    seconds: dict[str, float]  # by stage
    trace: Trace | None
    rejected: list[Rejected] = field(default_factory=list)

    def reject(self, corners_px: Floats, why: Rejected) -> None:
        self.rejected.append(why)
        if self.trace is not None:
            self.trace.dropped.append(Dropped(corners_px=corners_px, why=why))


class Pipeline:
    """Decodes the frames of one camera. Not shared between threads.

    `stream`: frames follow each other in time, and tracks add to what a frame shows; else each frame is alone, as it
    always is for the method `bands`. `robot`: how the camera sits on it, and its map; without, no fix is solved.
    Raises ValueError where the panels' values contradict each other.
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
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        if shown is not None:  # a recording's own panel values override the configuration's
            panels = panels.model_copy(
                update={f.name: getattr(shown, f.name) for f in fields(shown)}
            )
        self._panels = panels
        self._intrinsics = intrinsics
        self._clock = clock
        self._method: Method = method
        self._stream = stream
        self._cells = load_dictionary(panels.dictionary).cells_per_side
        self._finder = Finder(camera.width, camera.height, panels.spec(), smallest_px=self._cells * MIN_CELL_PX)
        dictionary, groups = load_dictionary(panels.dictionary), _same_frequencies(panels)
        codebooks = [soft.Codebook.build(ids, dictionary, spec) for spec, ids in groups]
        self._reader = Reader(codebooks, soft.FALSE_ID_RATE if stream else soft.FALSE_ID_RATE_ALONE)
        self._readers = [BandsReader(dictionary, ids, spec) for spec, ids in groups] if method == "bands" else []
        self._specs = tuple(spec for spec, _ in groups)
        sides_m = {marker_id: panels.spec(marker_id).side_m for marker_id in range(len(dictionary.words))}
        self._placer = Placer(intrinsics, sides_m, stream=stream, robot=robot)
        self._tracker = Tracker(self._specs)
        self._since_search = 0
        self._row_clock = RowClock(camera)
        if method == "soft":
            make_usual_filters()
        self.off_frequency: dict[int, PanelSpec] = {}  # by ID: panels that blink at others than announced, and at which

    @property
    def panels(self) -> PanelSettings:
        """The panels that are looked for: the configuration's, with what the source knows better."""
        return self._panels

    def decode(self, frame: Frame, trace: Trace | None = None) -> Decoded:
        """Everything that this frame shows. Time in `stage_ms` is from the picture in memory to the pose.

        `trace` takes in what each step made of the frame, and each candidate that was dropped; what `find` itself drops
        has no corners yet, and is only counted.
        """
        frame = self._with_true_row_time(frame)
        work = _Work(dict.fromkeys(STAGES[self._method], 0.0), trace)
        read = self._by_soft if self._method == "soft" else self._by_bands
        sightings, dropped = one_of_each(read(frame, work))
        for sighting, why in dropped:
            work.reject(sighting.corners_px, why)
        start = self._clock()
        markers = self._place(frame, sightings, work)
        fix = self._placer.fix(frame, markers)
        if isinstance(fix, Rejected):
            work.rejected.append(fix)
        self._timed(work, "pose", start)
        return Decoded(
            seq=frame.seq,
            row0_readout_ns=frame.row0_readout_ns,
            host_offset_ns=frame.host_offset_ns,
            markers=tuple(markers),
            robot=fix if isinstance(fix, RobotFix) else None,
            rejected=tuple(work.rejected),
            stage_ms={stage: 1e3 * seconds for stage, seconds in work.seconds.items()},
        )

    def _with_true_row_time(self, frame: Frame) -> Frame:
        """The frame, corrected where the stream's own times say that the driver misreports its row time."""
        if not self._stream:
            return frame
        before = self._row_clock.ratio
        self._row_clock.add(frame.seq, frame.row0_readout_ns)
        if abs(self._row_clock.ratio - before) > MIN_DEVIATION:  # what was seen so far was seen in the wrong bands
            self._tracker = Tracker(self._specs)
        return self._row_clock.corrected(frame)

    def _by_soft(self, frame: Frame, work: _Work) -> list[Sighting]:
        """find → edges → track → cells → soft, which is the likeliest word of all cells together."""
        if not self._stream:
            self._tracker = Tracker(self._specs)
        self._tracker.begin(frame.row0_readout_ns)
        followed = self._where_expected(frame, work)
        self._since_search += 1
        if self._since_search >= SEARCH_EVERY or not self._tracker.all_seen():
            self._since_search = 0
            followed += self._search(frame, work)
        return [s for quad, track in followed if (s := self._read(frame, quad, track, work)) is not None]

    def _where_expected(self, frame: Frame, work: _Work) -> list[tuple[Quad, Track]]:
        """The squares that are where their tracks lead; what is not there is left to a search."""
        start = self._clock()
        if self._finder.stripe_rows(frame):  # a rim that may be dark is seen from afar only
            return []
        tracks = self._tracker.expected()
        quads = self._refine(frame, [track.expected_px(frame.row0_readout_ns) for track in tracks])
        followed = [
            (there, track)
            for track, quad in zip(tracks, quads, strict=True)
            if (there := self._tracker.go_on(track, quad)) is not None
        ]
        self._timed(work, "edges", start)
        return followed

    def _search(self, frame: Frame, work: _Work) -> list[tuple[Quad, Track]]:
        """The squares in the whole picture, but for those that this frame has shown already."""
        start = self._clock()
        found, dropped = self._finder.find(frame)
        candidates = [c for c in found if not self._tracker.is_followed(c.centre_px, c.side_px)]
        work.rejected.extend(dropped)
        if work.trace is not None:
            work.trace.candidates.extend(candidates)
        since = self._timed(work, "find", start)
        near = approach_quads(
            frame,
            np.array([candidate.corners for candidate in candidates]),
            np.array([candidate.tolerance_px for candidate in candidates]),
            stripe_rows=self._finder.stripe_rows(frame),
        )
        refined = iter(self._refine(frame, [at for at in near if not isinstance(at, Rejected)]))
        self._timed(work, "edges", since)
        quads = []
        for candidate, at in zip(candidates, near, strict=True):
            quad = at if isinstance(at, Rejected) else next(refined)
            if isinstance(quad, Rejected):
                work.reject(candidate.corners, quad)
            else:
                quads.append(quad)
        return self._tracker.follow(quads)

    def _by_bands(self, frame: Frame, work: _Work) -> list[Sighting]:
        """The source paper's method, once for each pair of frequencies."""
        start = self._clock()
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
        return sightings

    def _timed(self, work: _Work, stage: str, since: float) -> float:
        now = self._clock()
        work.seconds[stage] += now - since
        return now

    def _refine(self, frame: Frame, near: list[Floats]) -> list[Quad | Rejected]:
        """The lit squares at these places, or why there are none."""
        striped = self._finder.stripe_rows(frame) > 0
        return refine_quads(frame, np.array(near), self._cells, self._intrinsics, striped=striped)

    def _read(self, frame: Frame, quad: Quad, track: Track, work: _Work) -> Sighting | None:
        """The panel that this lit square is, or None where none can be told; why is in `work`."""
        since = self._clock()
        samples = sample_cells(frame, quad, self._cells, self._intrinsics, like=track.memories[0].lattice)
        since = self._timed(work, "cells", since)
        if isinstance(samples, Rejected):
            work.reject(quad.corners_px, samples)
            return None
        outcome = self._reader.read(track, samples, frame)
        self._timed(work, "soft", since)
        if outcome.denied:
            work.reject(quad.corners_px, NOT_SHOWN)
        if work.trace is not None:
            evidence = track.memories[outcome.group].evidence()
            work.trace.looks.append(Look(quad=quad, samples=samples, evidence=evidence, reading=outcome.reading))
        if isinstance(outcome.reading, Rejected):
            work.reject(quad.corners_px, outcome.reading)
            return None
        if track.tuned is not None and track.tuned.measured:
            self.off_frequency[outcome.reading.id] = track.tuned.spec
        return _sighting(quad, outcome.reading, track)

    def _place(self, frame: Frame, sightings: list[Sighting], work: _Work) -> list[MarkerPose]:
        placed = self._placer.place(frame, sightings)
        for sighting, marker in zip(sightings, placed, strict=True):
            if isinstance(marker, Rejected):
                work.reject(sighting.corners_px, marker)
        return [marker for marker in placed if isinstance(marker, MarkerPose)]


def _same_frequencies(panels: PanelSettings) -> list[tuple[PanelSpec, list[int]]]:
    """The panel and the IDs of each kind of blinking that there is."""
    groups: dict[tuple[tuple[float, ...], float], tuple[PanelSpec, list[int]]] = {}
    for marker_id in range(len(load_dictionary(panels.dictionary).words)):
        spec = panels.spec(marker_id)
        groups.setdefault((spec.waves_hz, spec.duty), (spec, []))[1].append(marker_id)
    return list(groups.values())


def _sighting(quad: Quad, reading: soft.Reading, track: Track) -> Sighting:
    velocity = track.velocity_px_s
    return Sighting(
        id=reading.id,
        corners_px=read_only(corners_of_turned(quad.corners_px, reading.quarter_turns)),
        corner_sigma_px=quad.corner_sigma_px,
        margin=reading.margin,
        frames_used=track.frames,
        velocity_px_s=None if velocity is None else read_only(corners_of_turned(velocity, reading.quarter_turns)),
    )
