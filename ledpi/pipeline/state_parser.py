"""A pipeline's state, made again from plain values; tracks here, what else there is in `state_parts`.

Whoever wrote them may be anybody, as recordings come from anywhere. So each record is made by name, of numbers that are
checked one by one, and of arrays whose shapes follow from what the pipeline itself looks for: C reads them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ledpi.core.records import Frame, PanelSpec
from ledpi.decode.cells import MAX_LATTICE, MIN_LATTICE, CellSamples, Lattice, lattice
from ledpi.decode.evidence.comparison import Mean
from ledpi.decode.evidence.memory import ComparisonSum, PanelMemory
from ledpi.decode.evidence.noise import Correlation
from ledpi.decode.evidence.prediction import Prediction
from ledpi.decode.history import SEARCH_FRAMES, FrequencySearch, History, Identity
from ledpi.decode.identify.decision import Reading
from ledpi.decode.identify.frequency_search import Observation, Proposal
from ledpi.decode.model.prior import BLUR, COMMON, OWN
from ledpi.decode.track import Followed, TrackState
from ledpi.kernels.library import lib
from ledpi.pipeline.plain import Node
from ledpi.pipeline.state import PipelineState
from ledpi.pipeline.state_parts import MAX_IDS, MAX_PX, agenda_of, clock_of, frame_of, placed_of, spec_of

MAX_TRACKS, MAX_SQUARES = 4096, 65_536  # far more than a picture can show
MAX_PX_S = 1e9
MAX_UNKNOWN, MAX_BLUR = 1e3, 10.0  # of a fit: lengths in cells, shares of the light; the blur's is a logarithm


@dataclass(frozen=True, slots=True)
class StateParser:
    """Makes the state of a pipeline that looks for panels of `cells` × `cells` that blink like these `specs`."""

    cells: int
    specs: Sequence[PanelSpec]
    samples: Sequence[CellSamples] = ()
    frames: Sequence[Frame] = ()

    def state(self, node: Node) -> PipelineState:
        """The state that `as_plain` has written. Raises ValueError: where, what is wrong, what would be right."""
        samples = [self._samples(each) for each in node["samples"].items(MAX_SQUARES)]
        frames = [frame_of(each) for each in node["frames"].items(MAX_SQUARES)]
        parser = StateParser(self.cells, self.specs, samples, frames)
        return PipelineState(
            followed=parser._followed(node["followed"]),
            agenda=agenda_of(node["agenda"]),
            clock=clock_of(node["clock"]),
            placed=placed_of(node["placed"]),
            off_frequency=tuple(
                (marker_id.integer(MAX_IDS), spec_of(spec, self.specs))
                for marker_id, spec in node["off_frequency"].pairs(MAX_IDS)
            ),
        )

    def _samples(self, node: Node) -> CellSamples:
        grid = self._lattice(node["lattice"])
        shape = grid.u.shape
        return CellSamples(
            lattice=grid,
            light=node["light"].array(np.float32, *shape),
            valid=node["valid"].optional(lambda valid: valid.array(np.bool_, *shape)),
            rows=node["rows"].array(np.float32, *shape, max_abs=MAX_PX),
            cell_px=node["cell_px"].pair(lambda px: px.real(0.0, MAX_PX)),
            independence=node["independence"].real(0.0, 1.0),
            linear=node["linear"].boolean(),
        )

    def _lattice(self, node: Node) -> Lattice:
        return lattice(self.cells, node.integer(MAX_LATTICE, min_value=MIN_LATTICE))

    def _samples_and_frame(self, samples: Node, frame: Node) -> tuple[CellSamples, Frame]:
        return (
            self.samples[samples.integer(len(self.samples) - 1)],
            self.frames[frame.integer(len(self.frames) - 1)],
        )

    def _followed(self, node: Node) -> Followed:
        tracks = [(self._track_state(a), self._history(b)) for a, b in node["tracks"].pairs(MAX_TRACKS)]
        return Followed(tuple(tracks), node["before_ns"].integer(), node["now_ns"].integer())

    def _track_state(self, node: Node) -> TrackState:
        return TrackState(
            corners_px=node["corners_px"].array(np.float64, 4, 2, max_abs=MAX_PX),
            velocity_px_s=node["velocity_px_s"].optional(lambda v: v.array(np.float64, 4, 2, max_abs=MAX_PX_S)),
            seen_ns=node["seen_ns"].integer(),
            unknown=node["unknown"].optional(self._unknown),
            residual=node["residual"].real(0.0),
        )

    def _unknown(self, node: Node) -> Any:
        unknown = node.array(np.float64, COMMON + OWN * self.cells**2, max_abs=MAX_UNKNOWN)
        if abs(unknown[BLUR]) > MAX_BLUR:
            raise node.error(f"a blur within ±{MAX_BLUR:g}")
        return unknown

    def _history(self, node: Node) -> History:
        memories = node["memories"].items(len(self.specs), min_count=len(self.specs))
        return History(
            memories=tuple(self._memory(each, spec) for each, spec in zip(memories, self.specs, strict=True)),
            last=node["last"].optional(self._identity),
            uninformative=node["uninformative"].integer(),
            matched=node["matched"].integer(),
            confirmed=node["confirmed"].integer(),
            search=self._search(node["search"]),
        )

    def _memory(self, node: Node, like: PanelSpec) -> PanelMemory:
        spec = spec_of(node["spec"], (like,))
        last = node["last"].optional(lambda pair: self._samples_and_frame(*pair.pair(lambda each: each)))
        frames = node["frames"].integer()
        if (last is None) != (frames == 0):
            raise node["last"].error("null where there were no frames, and nowhere else")
        bands = 2 * len(spec.waves_hz)
        return PanelMemory(
            spec=spec,
            frames=frames,
            origin_ns=node["origin_ns"].integer(),
            last=last,
            running_mean=None
            if last is None
            else node["running_mean"].optional(lambda mean: _mean(mean, bands, last[0].lattice)),
            comparisons=node["comparisons"].optional(lambda sums: self._comparisons(sums, bands)),
        )

    def _comparisons(self, node: Node, bands: int) -> ComparisonSum:
        noise = node["noise"]
        shape = (self.cells**2, bands)
        return ComparisonSum(
            score=node["score"].array(np.float64, *shape),
            information=node["information"].array(np.float64, *shape, *shape),
            residual=node["residual"].real(),
            noise=Correlation(*(noise[name].real() for name in ("excess", "deviation", "growth"))),
            count=node["count"].real(0.0),
        )

    def _identity(self, node: Node) -> Identity:
        group = node["group"].integer(len(self.specs) - 1)
        reading = node["reading"]
        return Identity(
            group=group,
            reading=Reading(
                id=reading["id"].integer(MAX_IDS),
                quarter_turns=reading["quarter_turns"].integer(3),
                margin=reading["margin"].real(),
                likelihood=reading["likelihood"].real(),
                amplitude=reading["amplitude"].pair(lambda a: a.real()),
                cell_bands=reading["cell_bands"].array(np.float64, self.cells**2, 2 * len(self.specs[group].waves_hz)),
            ),
            prediction=node["prediction"].optional(self._prediction),
        )

    def _prediction(self, node: Node) -> Prediction:
        grid = self._lattice(node["lattice"])
        shape, cells = grid.u.shape, self.cells**2
        return Prediction(
            lattice=grid,
            origin_ns=node["origin_ns"].integer(),
            picture=node["picture"].array(np.float32, *shape),
            root=node["root"].array(np.float32, *shape),
            basis=node["basis"].array(np.float32, lib.LEDPI_NUISANCES, grid.u.size),
            residual_bands=node["residual_bands"].array(np.float32, *shape),
            hz=node["hz"].array(np.float64, cells),
            depth=node["depth"].array(np.float32, cells, 1),
            phase=node["phase"].array(np.float64, cells),
            noise_inflation=node["noise_inflation"].real(1.0),
            typical_nats=node["typical_nats"].real(),
        )

    def _search(self, node: Node) -> FrequencySearch:
        observations = node["observations"].items(SEARCH_FRAMES)
        seen = [self._samples_and_frame(each["samples"], each["frame"]) for each in observations]
        return FrequencySearch(
            observations=tuple(Observation(samples=samples, frame=frame) for samples, frame in seen),
            frames_since_try=node["frames_since_try"].integer(),
            found=node["found"].optional(
                lambda found: Proposal(spec=spec_of(found["spec"], self.specs), measured=found["measured"].boolean())
            ),
            found_from=node["found_from"].integer(),
        )


def _mean(node: Node, bands: int, grid: Lattice) -> Mean:
    shape = grid.u.shape
    return Mean(
        picture=node["picture"].array(np.float32, *shape),
        count=node["count"].array(np.float32, *shape),
        waves=node["waves"].array(np.float32, bands, *shape),
    )
