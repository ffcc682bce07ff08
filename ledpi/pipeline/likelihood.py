"""The likelihood method's part of the path: propose → fit → track → cells → identify."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator, Sequence
from typing import TypeAlias

from ledpi.config.panels import PanelSettings
from ledpi.core.codewords import corners_of_turned, covariance_of_turned
from ledpi.core.geometry import quad_side
from ledpi.core.records import CameraInfo, Detection, Floats, Frame, Intrinsics, PanelSpec, Quad, Rejected, read_only
from ledpi.decode.agenda import Agenda, alone
from ledpi.decode.evidence.cells import Observation, sample_cells
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.evidence.waves import FAINT_DEPTH, are_sinusoids, band_depth
from ledpi.decode.following import MOST_FITS
from ledpi.decode.history import Identity
from ledpi.decode.identify import decision
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.locate import MIN_EXPLAINED_HIDDEN, Locator
from ledpi.decode.model.fit import Fitted
from ledpi.decode.model.picture import PanelPicture
from ledpi.decode.proposals import Candidate, Proposer
from ledpi.decode.reader import Outcome, Reader
from ledpi.decode.states import Event
from ledpi.decode.track import CONTRADICTED, SAME_CELLS, SAME_PLACE, SAME_START, Track, Tracker, overlap, place_of
from ledpi.pipeline.results import Results
from ledpi.pipeline.trace import SquareTrace

# What a frame may spend in all stages, in places at which a fit compares its model with the picture (.2 µs each on a
# PC; finding takes 20,000 and more, most candidates 10,000, a new panel 100,000, one that is followed 20,000): a frame
# period in a stream, which takes up in the next frame what is left; no more is to come where a frame is alone.
STREAM_BUDGET, SINGLE_BUDGET = 150_000, 2_000_000
SEARCH_SHARE = 0.25  # of it, in a frame in which a search is due: panels that are followed leave it so much at least
EACH_READ, READING = 3000, 15_000  # places that reading a panel costs beside its looks, and with them
OTHERS = 0.5  # share of it that others have beside panels that are followed, which are to be shown soon again
NO_TIME = Rejected(stage="track", reason="no_time")  # for a panel in this frame: the next one begins with it

Groups: TypeAlias = Sequence[tuple[PanelSpec, list[int]]]  # of IDs that blink alike
_Observed: TypeAlias = tuple[Quad, Track, Observation]


class LikelihoodPath:
    """Reads panels by the likeliest codeword of all cells together, in the frames of one camera.

    `stream`: frames follow each other in time, and tracks add to what a frame shows; else each frame is alone.
    """

    def __init__(
        self, camera: CameraInfo, panels: PanelSettings, groups: Groups, intrinsics: Intrinsics | None, *, stream: bool
    ) -> None:
        dictionary = panels.words
        self._cells, self._specs = dictionary.cells_per_side, tuple(spec for spec, _ in groups)
        self._intrinsics, self._stream = intrinsics, stream
        codebooks = [Codebook.build(ids, dictionary, spec) for spec, ids in groups]
        self._searches = panels.search_frequencies
        self._weigher = LightWeigher(self._cells, intrinsics)
        self._reader = Reader(codebooks, self._weigher, decision.FALSE_ID_RATE, search_frequencies=self._searches)
        self._proposer = Proposer(camera, self._cells, self._specs)
        self._locator = Locator(self._cells, self._specs, intrinsics, must_blink=not panels.search_frequencies)
        self.search_budget = STREAM_BUDGET if stream else SINGLE_BUDGET
        self._reads = 0  # squares that were compared with codewords
        self.off_frequency: dict[int, PanelSpec] = {}  # by ID: panels that blink at others than announced, and at which
        self.forget()

    def forget(self) -> None:
        """Follows nothing."""
        self._tracker, self._agenda = Tracker(self._specs, self._cells), Agenda()

    @property
    def spent(self) -> int:
        """On all stages so far, those that followed panels too, as the budget counts it."""
        return self._locator.spent + self._proposer.sampled + self._weigher.sampled + self._reads * EACH_READ

    def read(self, frame: Frame, work: Results) -> Iterator[list[Detection]]:
        """propose → fit → track → cells → identify, by the likeliest codeword of all cells together.

        All share the budget. Tracked panels come first, at their predicted places.
        """
        if not self._stream:
            self.forget()
        self._tracker.begin_frame(frame.row0_readout_ns)
        most = self.spent + self.search_budget
        reserved = int(SEARCH_SHARE * self.search_budget) if self._agenda.is_due_next else 0
        yield self._identify(frame, self._follow(frame, self._tracker.read_tracks(), most - reserved, work), work)
        if is_followed := any(self._tracker.panels_shown()):
            most = min(most, self.spent + int(OTHERS * self.search_budget))
        for track in self._tracker.unread_tracks():
            track.waits = self.spent >= most - reserved
            if not track.waits:
                yield self._identify(frame, self._follow(frame, [track], most - reserved, work), work)
        if self._agenda.is_due(self._tracker.panels_shown()):
            yield from self._search(frame, most, work, is_urgent=not is_followed)

    def _follow(self, frame: Frame, tracks: list[Track], most: int, work: Results) -> list[_Observed]:
        """The squares at their tracks' predictions, until `most` is spent; what is not there is left to a search."""
        start = time.perf_counter()
        followed = list[tuple[Quad, Track]]()
        for track in tracks:
            track.waits = self.spent + READING * len(followed) >= most
            if track.waits:
                work.reject(track.state.corners_px, NO_TIME)
                continue
            at = track.state.predicted_px(frame.row0_readout_ns)
            quad, track.picture = self._at(frame, track, at)
            there = self._tracker.continue_track(track, quad)
            if there is not None:
                followed.append((there, track))
        work.add_time("fit", start)
        return self._observe(frame, followed, work)

    def _at(self, frame: Frame, track: Track, at: Floats) -> tuple[Quad | Rejected, PanelPicture | None]:
        """The square of a track at its predicted corners; and the picture that it still may be followed by."""
        followed = None if track.picture is None else self._locator.follower.follow(frame, at, track.picture)
        if followed is not None:
            return followed
        known, is_new = track.state.unknown, track.state.velocity_px_s is None
        if known is None or (is_new and band_depth(frame, self._specs) > FAINT_DEPTH):  # bands may have hidden an end
            return self._locator.localise(frame, at), None
        found = self._locator.refine(frame, at, known)
        if isinstance(found, Rejected) and is_new:  # how it moves is not known yet
            found = self._locator.localise(frame, at)
        return found, None

    def _search(self, frame: Frame, most: int, work: Results, *, is_urgent: bool) -> Iterator[list[Detection]]:
        """The panels that candidates lead to, while less than `most` is spent.

        In a frame that is alone what its even fit explains no better than a lattice that is off waits for the others:
        most of it lies on a panel that is read by then.
        """
        proposed, is_read = self._propose(frame, work), False
        waiting: list[tuple[Fitted, Candidate]] = []
        most = max(most, self.spent + 1)  # one is tried in any case
        for candidate in self._in_order(proposed, is_urgent=is_urgent):
            if self.spent >= most or (is_read and not self._stream and not candidate.likely):
                if is_read:
                    self._agenda.search_next()  # where there is one panel there may be more
                break
            if self._tracker.is_followed(candidate.corners_px, SAME_CELLS if candidate.dark_rows else SAME_START):
                continue
            fit = self._begin(frame, candidate.corners_px, work)
            if isinstance(fit, Fitted):
                if self._stream or fit.explained >= MIN_EXPLAINED_HIDDEN:
                    yield (found := self._finish(frame, fit, work))
                    is_read = is_read or bool(found)
                else:
                    waiting.append((fit, candidate))
            in_vain = not self._tracker.is_followed(candidate.corners_px, SAME_START)
            self._agenda.tried(candidate, in_vain=in_vain)
        for fit, candidate in sorted(waiting, key=lambda one: -one[0].explained):
            if self.spent < most and not self._tracker.is_followed(fit.corners_px):
                yield self._finish(frame, self._with_ends_moved(frame, fit, candidate, work), work)

    def _in_order(self, proposed: list[Candidate], *, is_urgent: bool) -> list[Candidate]:
        """The candidates in the order in which they are tried: in a stream first where a panel is missing."""
        if not self._stream:
            return alone(proposed)
        missing = [Candidate(at, quad_side(at.tolist())) for at in self._tracker.missing_px()]
        places = [place_of(one.corners_px) for one in missing]
        first = [one.likely and any(overlap(place_of(one.corners_px), at) for at in places) for one in proposed]
        others = [one for one, is_first in zip(proposed, first, strict=True) if not is_first]
        return [*missing, *itertools.compress(proposed, first), *self._agenda.schedule(others, is_urgent=is_urgent)]

    def _with_ends_moved(self, frame: Frame, fit: Fitted, candidate: Candidate, work: Results) -> Fitted:
        """The best even fit at a candidate or with its ends moved, as one of them may be in a dark band.

        In a stream the next frame's bands are elsewhere.
        """
        for at in candidate.moved_ends():
            if fit.explained >= MIN_EXPLAINED_HIDDEN:
                break
            if self._tracker.is_followed(at):
                continue
            other = self._begin(frame, at, work)
            if isinstance(other, Fitted) and other.explained > fit.explained:
                fit = other
        return fit

    def _propose(self, frame: Frame, work: Results) -> list[Candidate]:
        start = time.perf_counter()
        candidates, dropped = self._proposer.propose(frame, self._agenda.turn if self._stream else None)
        work.rejected.extend(dropped)
        if work.trace is not None:
            work.trace.candidates.extend(candidates)
            work.trace.searched = True
        work.add_time("find", start)
        return candidates

    def _begin(self, frame: Frame, corners_px: Floats, work: Results) -> Fitted | Rejected:
        """The even fit at a candidate (4, 2), or why there is none."""
        start = time.perf_counter()
        fit = self._locator.begin(frame, corners_px)
        work.add_time("fit", start)
        if isinstance(fit, Rejected):
            work.reject(corners_px, fit)
        return fit

    def _finish(self, frame: Frame, fit: Fitted, work: Results) -> list[Detection]:
        """The panel that an even fit has found, if it is one and can be read."""
        start = time.perf_counter()
        quad = self._locator.finish(frame, fit)
        work.add_time("fit", start)
        if isinstance(quad, Rejected):
            work.reject(fit.corners_px, quad)
            return []
        associated = self._tracker.associate(quad)
        if associated is None:
            work.reject(quad.corners_px, SAME_PLACE)
            return []
        return self._identify(frame, self._observe(frame, [associated], work), work)

    def _observe(self, frame: Frame, squares: list[tuple[Quad, Track]], work: Results) -> list[_Observed]:
        """The light of the squares, of those that show some."""
        since = time.perf_counter()
        seen = []
        for quad, track in squares:
            before = track.history.memories[0].last
            like = None if before is None or before.samples is None else before.samples.lattice
            shown = self._locator.observe(frame, quad, sampled=self._searches, like=like)
            if isinstance(shown, Rejected):
                work.reject(quad.corners_px, shown)
            else:
                seen.append((quad, track, shown))
        work.add_time("cells", since)
        return seen

    def _identify(self, frame: Frame, observed: list[_Observed], work: Results) -> list[Detection]:
        """The panels among these squares; the reasons against the others go to `work`."""
        since = time.perf_counter()
        detections = []
        for quad, track, seen in observed:
            was_read = track.history.identity is not None
            outcome = self._reader.read(track.history, seen)
            self._reads += 1
            track.history = outcome.history
            if outcome.event is Event.CONTRADICTS:
                work.reject(quad.corners_px, CONTRADICTED)
            if work.trace is not None:
                work.trace.squares += self._traced(frame, quad, seen, outcome)
            if isinstance(outcome.identity, Rejected):
                work.reject(quad.corners_px, outcome.identity)
                if outcome.identity == decision.STEADY and track.history.last is None and not self._searches:
                    track.is_none = True
                    self._agenda.refuse(quad.corners_px)
                continue
            if not was_read:  # what was not may have been fitted a part of a cell beside
                track.state = track.state.forget_velocity()
            detections.append(self._detection(quad, outcome.identity, track))
        if self._stream:
            for quad, track, _ in observed:
                track.picture = self._next_picture(frame, quad, track)
        work.add_time("identify", since)
        return detections

    def _traced(self, frame: Frame, quad: Quad, seen: Observation, outcome: Outcome) -> list[SquareTrace]:
        """The square's record, where its cells can be sampled for people to look at."""
        samples = seen.samples or sample_cells(frame, quad, self._cells, self._intrinsics)
        if isinstance(samples, Rejected):
            return []
        identity, history = outcome.identity, outcome.history
        group = 0 if isinstance(identity, Rejected) else identity.group
        reading = identity if isinstance(identity, Rejected) else identity.reading
        evidence = history.memories[group].evidence(self._weigher)
        return [SquareTrace(quad=quad, seen=seen, samples=samples, evidence=evidence, reading=reading)]

    def _detection(self, quad: Quad, identity: Identity, track: Track) -> Detection:
        assert quad.covariance_px2 is not None, "the localisation measures it"
        reading, tuned = identity.reading, track.history.search.found
        velocity, velocity_covariance = track.state.velocity_px_s, track.state.velocity_covariance
        if tuned is not None and tuned.measured and track.history.memories[identity.group].spec == tuned.spec:
            self.off_frequency[reading.id] = tuned.spec
        return Detection(
            id=reading.id,
            corners_px=read_only(corners_of_turned(quad.corners_px, reading.quarter_turns)),
            covariance_px2=read_only(covariance_of_turned(quad.covariance_px2, reading.quarter_turns)),
            blur_px=quad.blur_px,
            margin=reading.margin,
            frames_used=track.history.frames,
            velocity_px_s=None if velocity is None else read_only(corners_of_turned(velocity, reading.quarter_turns)),
            velocity_covariance=None
            if velocity_covariance is None
            else read_only(covariance_of_turned(velocity_covariance, reading.quarter_turns)),
        )

    def _next_picture(self, frame: Frame, quad: Quad, track: Track) -> PanelPicture | None:
        """The picture to follow the panel by: none while its ID is not known, or where bands are deep."""
        identity = track.history.identity
        spec = None if identity is None else track.history.memories[identity.group].spec
        if identity is None or spec is None or not are_sinusoids(frame.exposure_us, spec):
            track.fits = ()
            return None
        if track.picture is not None:
            return track.picture if track.picture.spec == spec else None
        if quad.unknown is not None and quad.hidden is None:
            track.fits = (*track.fits[1 - MOST_FITS :], quad.unknown)
        return self._locator.follower.begin(frame, quad, track.fits, spec, identity.reading.cell_bands)
