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
from ledpi.pipeline.state_parts import MOST_IDS, MOST_PX, agenda_of, clock_of, frame_of, placed_of, spec_of

MOST_TRACKS, MAX_SQUARES = 4096, 65_536  # far more than a picture can show
MOST_PX_S = 1e9
MOST_UNKNOWN, MOST_BLUR = 1e3, 10.0  # of a fit: lengths in cells, shares of the light; the blur's is a logarithm


@dataclass(frozen=True, slots=True)
class Maker:
    """Makes the state of a pipeline that looks for panels of `cells` × `cells` that blink like these `specs`."""

    cells: int
    specs: Sequence[PanelSpec]
    samples: Sequence[CellSamples] = ()
    frames: Sequence[Frame] = ()

    def state(self, node: Node) -> PipelineState:
        """The state that `as_plain` has written. Raises ValueError: where, what is wrong, what would be right."""
        samples = [self._samples(each) for each in node["samples"].each(MAX_SQUARES)]
        frames = [frame_of(each) for each in node["frames"].each(MAX_SQUARES)]
        with_looks = Maker(self.cells, self.specs, samples, frames)
        return PipelineState(
            followed=with_looks._followed(node["followed"]),
            agenda=agenda_of(node["agenda"]),
            clock=clock_of(node["clock"]),
            placed=placed_of(node["placed"]),
            off_frequency=tuple(
                (marker_id.natural(MOST_IDS), spec_of(spec, self.specs))
                for marker_id, spec in node["off_frequency"].pairs(MOST_IDS)
            ),
        )

    def _samples(self, node: Node) -> CellSamples:
        grid = self._lattice(node["lattice"])
        shape = grid.u.shape
        return CellSamples(
            lattice=grid,
            light=node["light"].array(np.float32, *shape),
            valid=node["valid"].maybe(lambda valid: valid.array(np.bool_, *shape)),
            rows=node["rows"].array(np.float32, *shape, most=MOST_PX),
            cell_px=node["cell_px"].two(lambda px: px.real(0.0, MOST_PX)),
            sides_px=node["sides_px"].two(_complex),
            independence=node["independence"].real(0.0, 1.0),
            linear=node["linear"].flag(),
        )

    def _lattice(self, node: Node) -> Lattice:
        return lattice(self.cells, node.natural(MAX_LATTICE, least=MIN_LATTICE))

    def _look(self, samples: Node, frame: Node) -> tuple[CellSamples, Frame]:
        return (
            self.samples[samples.natural(len(self.samples) - 1)],
            self.frames[frame.natural(len(self.frames) - 1)],
        )

    def _followed(self, node: Node) -> Followed:
        tracks = [(self._track_state(a), self._history(b)) for a, b in node["tracks"].pairs(MOST_TRACKS)]
        return Followed(tuple(tracks), node["before_ns"].natural(), node["now_ns"].natural())

    def _track_state(self, node: Node) -> TrackState:
        return TrackState(
            corners_px=node["corners_px"].array(np.float64, 4, 2, most=MOST_PX),
            velocity_px_s=node["velocity_px_s"].maybe(lambda v: v.array(np.float64, 4, 2, most=MOST_PX_S)),
            seen_ns=node["seen_ns"].natural(),
            unknown=node["unknown"].maybe(self._unknown),
            unexplained=node["unexplained"].real(-1.0, 1.0),
        )

    def _unknown(self, node: Node) -> Any:
        unknown = node.array(np.float64, COMMON + OWN * self.cells**2, most=MOST_UNKNOWN)
        if abs(unknown[BLUR]) > MOST_BLUR:
            raise node.wrong(f"a blur within ±{MOST_BLUR:g}")
        return unknown

    def _history(self, node: Node) -> History:
        memories = node["memories"].each(len(self.specs), least=len(self.specs))
        return History(
            memories=tuple(self._memory(each, spec) for each, spec in zip(memories, self.specs, strict=True)),
            last=node["last"].maybe(self._identity),
            uninformative=node["uninformative"].natural(),
            matched=node["matched"].natural(),
            confirmed=node["confirmed"].natural(),
            search=self._search(node["search"]),
        )

    def _memory(self, node: Node, like: PanelSpec) -> PanelMemory:
        spec = spec_of(node["spec"], (like,))
        last = node["last"].maybe(lambda pair: self._look(*pair.two(lambda each: each)))
        frames = node["frames"].natural()
        if (last is None) != (frames == 0):
            raise node["last"].wrong("null where there were no frames, and nowhere else")
        bands = 2 * len(spec.waves_hz)
        return PanelMemory(
            spec=spec,
            frames=frames,
            origin_ns=node["origin_ns"].natural(),
            last=last,
            running_mean=None
            if last is None
            else node["running_mean"].maybe(lambda mean: _mean(mean, bands, last[0].lattice)),
            comparisons=node["comparisons"].maybe(lambda sums: self._comparisons(sums, bands)),
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
        group = node["group"].natural(len(self.specs) - 1)
        reading = node["reading"]
        return Identity(
            group=group,
            reading=Reading(
                id=reading["id"].natural(MOST_IDS),
                quarter_turns=reading["quarter_turns"].natural(3),
                margin=reading["margin"].real(),
                likelihood=reading["likelihood"].real(),
                amplitude=reading["amplitude"].two(lambda a: a.real()),
                cell_bands=reading["cell_bands"].array(np.float64, self.cells**2, 2 * len(self.specs[group].waves_hz)),
            ),
            prediction=node["prediction"].maybe(self._prediction),
        )

    def _prediction(self, node: Node) -> Prediction:
        grid = self._lattice(node["lattice"])
        shape, cells = grid.u.shape, self.cells**2
        return Prediction(
            lattice=grid,
            origin_ns=node["origin_ns"].natural(),
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
        seen = [self._look(each["samples"], each["frame"]) for each in node["observations"].each(SEARCH_FRAMES)]
        return FrequencySearch(
            observations=tuple(Observation(samples=samples, frame=frame) for samples, frame in seen),
            frames_since_try=node["frames_since_try"].natural(),
            found=node["found"].maybe(
                lambda found: Proposal(spec=spec_of(found["spec"], self.specs), measured=found["measured"].flag())
            ),
            found_from=node["found_from"].natural(),
        )


def _mean(node: Node, bands: int, grid: Lattice) -> Mean:
    shape = grid.u.shape
    return Mean(
        picture=node["picture"].array(np.float32, *shape),
        count=node["count"].array(np.float32, *shape),
        waves=node["waves"].array(np.float32, bands, *shape),
    )


def _complex(node: Node) -> complex:
    return complex(*node.two(lambda part: part.real(-MOST_PX, MOST_PX)))
