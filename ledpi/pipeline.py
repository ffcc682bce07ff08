"""The path of one frame: find → edges → cells → identify → pose. The only module that knows all stages."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ledpi.camera.base import CameraInfo, PanelValues
from ledpi.config import PanelSettings
from ledpi.decode import soft
from ledpi.decode.cells import MIN_CELL_PX, sample_cells
from ledpi.decode.edges import approach_quads, refine_quad
from ledpi.decode.evidence import Evidence
from ledpi.decode.find import Candidate, Finder
from ledpi.decode.track import NOT_SHOWN, Track, Tracker, contradicts
from ledpi.markers import corners_of_turned, load_dictionary
from ledpi.pose.planar import solve_square
from ledpi.records import (
    Decoded,
    Floats,
    Frame,
    Intrinsics,
    MarkerPose,
    PanelSpec,
    Quad,
    Rejected,
    Sighting,
    read_only,
)
from ledpi.shutter import row_mid_exposure_ns

SAME_PLACE = Rejected(stage="identify", reason="same_panel_twice")
SAME_ID = Rejected(stage="identify", reason="same_id_twice")
STAGES = ("find", "edges", "cells", "soft", "pose")
# Told where in the picture something four-sided was dropped, (4, 2) corners in pixels, and why.
Observer = Callable[[Floats, Rejected], None]


@dataclass(slots=True)
class _Work:
    """What one frame has given so far."""

    observer: Observer | None
    rejected: list[Rejected] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(STAGES, 0.0))

    def reject(self, corners_px: Floats, why: Rejected) -> None:
        self.rejected.append(why)
        if self.observer is not None:
            self.observer(corners_px, why)


class Pipeline:
    """Decodes the frames of one camera. Not shared between threads.

    `stream`: frames follow each other in time, and tracks add to what a frame shows; else each frame is alone.
    Raises ValueError where the panels' values contradict each other.
    """

    def __init__(
        self,
        camera: CameraInfo,
        panels: PanelSettings,
        *,
        intrinsics: Intrinsics | None,
        shown: PanelValues | None = None,
        stream: bool = True,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        if shown is not None:  # a recording's own panel values override the configuration's
            panels = panels.model_copy(
                update={key: getattr(shown, key) for key in ("dictionary", "side_m", "black_hz", "white_hz", "duty")}
            )
        self._panels = panels
        self._intrinsics = intrinsics
        self._clock = clock
        self._stream = stream
        self._false_id_rate = soft.FALSE_ID_RATE if stream else soft.FALSE_ID_RATE_ALONE
        self._cells = load_dictionary(panels.dictionary).cells_per_side
        self._finder = Finder(camera.width, camera.height, panels.spec(), smallest_px=self._cells * MIN_CELL_PX)
        self._codebooks = _codebooks(panels)
        self._specs = tuple(book.spec for book in self._codebooks)
        self._tracker = Tracker(self._specs)

    @property
    def panels(self) -> PanelSettings:
        """The panels that are looked for: the configuration's, with what the source knows better."""
        return self._panels

    def decode(self, frame: Frame, observer: Observer | None = None) -> Decoded:
        """Everything that this frame shows. Time in `stage_ms` is from the picture in memory to the pose.

        `observer` is told of each candidate that is dropped; what `find` itself drops has no corners yet, and is
        only counted.
        """
        work = _Work(observer)
        start = self._clock()
        candidates, dropped = self._finder.find(frame)
        work.rejected.extend(dropped)
        since = self._timed(work, "find", start)
        near = approach_quads(
            frame,
            np.array([candidate.corners for candidate in candidates]),
            np.array([candidate.tolerance_px for candidate in candidates]),
            striped=any(candidate.striped for candidate in candidates),
        )
        self._timed(work, "edges", since)
        looks = zip(candidates, near, strict=True)
        quads = [quad for candidate, at in looks if (quad := self._refine(frame, candidate, at, work)) is not None]
        if not self._stream:
            self._tracker = Tracker(self._specs)
        followed = self._tracker.follow(quads, frame.row0_readout_ns)
        sightings = [s for quad, track in followed if (s := self._read(frame, quad, track, work)) is not None]
        sightings = _one_of_each(sightings, work)
        start = self._clock()
        markers = tuple(m for s in sightings if (m := self._place(frame, s, work)) is not None)
        work.seconds["pose"] = self._clock() - start
        return Decoded(
            seq=frame.seq,
            row0_readout_ns=frame.row0_readout_ns,
            host_offset_ns=frame.host_offset_ns,
            markers=markers,
            robot=None,
            rejected=tuple(work.rejected),
            stage_ms={stage: 1e3 * seconds for stage, seconds in work.seconds.items()},
        )

    def _timed(self, work: _Work, stage: str, since: float) -> float:
        now = self._clock()
        work.seconds[stage] += now - since
        return now

    def _refine(self, frame: Frame, candidate: Candidate, near: Floats | Rejected, work: _Work) -> Quad | None:
        """The lit square at a candidate's place, or None where it is none; why is in `work`."""
        since = self._clock()
        refined = (
            near
            if isinstance(near, Rejected)
            else refine_quad(frame, near, self._intrinsics, striped=candidate.striped)
        )
        self._timed(work, "edges", since)
        if isinstance(refined, Rejected):
            work.reject(candidate.corners, refined)
            return None
        return refined

    def _read(self, frame: Frame, quad: Quad, track: Track, work: _Work) -> Sighting | None:
        """The panel that this lit square is, or None where none can be told; why is in `work`."""
        since = self._clock()
        samples = sample_cells(frame, quad, self._cells, self._intrinsics, like=track.memories[0].lattice)
        since = self._timed(work, "cells", since)
        if isinstance(samples, Rejected):
            work.reject(quad.corners_px, samples)
            return None
        added = [memory.add(samples, frame) for memory in track.memories]
        if track.shown is not None and all(map(contradicts, added, track.shown)):
            work.reject(quad.corners_px, NOT_SHOWN)
            track.forget()
            for memory in track.memories:
                memory.add(samples, frame)
        readings = [
            soft.decide(evidence, book, self._false_id_rate) if isinstance(evidence, Evidence) else evidence
            for book, evidence in zip(self._codebooks, (m.evidence() for m in track.memories), strict=True)
        ]
        reading = soft.surest(readings, self._false_id_rate)
        self._timed(work, "soft", since)
        if isinstance(reading, Rejected):
            work.reject(quad.corners_px, reading)
            track.shown = None
            return None
        track.shown = tuple(reading.cell_bands if r is reading else np.zeros_like(reading.cell_bands) for r in readings)
        return _sighting(quad, reading, frames_used=track.memories[0].frames)

    def _place(self, frame: Frame, sighting: Sighting, work: _Work) -> MarkerPose | None:
        centre_row = float(sighting.corners_px[:, 1].mean())
        solution = alternate = None
        if self._intrinsics is not None:
            side_m = self._panels.spec(sighting.id).side_m
            solved = solve_square(sighting.corners_px, sighting.corner_sigma_px, side_m, self._intrinsics)
            if isinstance(solved, Rejected):
                work.reject(sighting.corners_px, solved)
                return None
            solution, alternate = solved
        return MarkerPose(
            sighting=sighting,
            mid_exposure_ns=row_mid_exposure_ns(frame, centre_row),
            solution=solution,
            alternate=alternate,
        )


def _codebooks(panels: PanelSettings) -> list[soft.Codebook]:
    """One for each pair of frequencies and duty that the panels have."""
    dictionary = load_dictionary(panels.dictionary)
    groups: dict[tuple[float, float, float], tuple[PanelSpec, list[int]]] = {}
    for marker_id in range(len(dictionary.words)):
        spec = panels.spec(marker_id)
        groups.setdefault((spec.black_hz, spec.white_hz, spec.duty), (spec, []))[1].append(marker_id)
    return [soft.Codebook.build(ids, dictionary, spec) for spec, ids in groups.values()]


def _sighting(quad: Quad, reading: soft.Reading, frames_used: int) -> Sighting:
    return Sighting(
        id=reading.id,
        corners_px=read_only(corners_of_turned(quad.corners_px, reading.quarter_turns)),
        corner_sigma_px=quad.corner_sigma_px,
        margin=reading.margin,
        frames_used=frames_used,
    )


def _one_of_each(sightings: list[Sighting], work: _Work) -> list[Sighting]:
    """The surest sighting of each panel. An ID that is in two places at once is in neither."""
    kept: list[Sighting] = []
    for sighting in sorted(sightings, key=lambda s: -s.margin):
        centre = sighting.corners_px.mean(axis=0)
        if any(_inside(centre, other.corners_px) for other in kept):
            work.reject(sighting.corners_px, SAME_PLACE)
        else:
            kept.append(sighting)
    ids = [s.id for s in kept]
    for sighting in kept:
        if ids.count(sighting.id) > 1:
            work.reject(sighting.corners_px, SAME_ID)
    return [s for s in kept if ids.count(s.id) == 1]


def _inside(point: Floats, corners: Floats) -> bool:
    """Whether a point lies within a convex quad, clockwise in the picture."""
    along = np.roll(corners, -1, axis=0) - corners
    to = point - corners
    return bool((along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0] > 0).all())
