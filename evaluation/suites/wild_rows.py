"""The rows of the suite `wild`, the ranges that its takes are drawn from, and how they are drawn.

The ranges are wider than what people build, and everything varies at once. Points come from Sobol's sequence, scrambled
by the seed, which fills a space of many dimensions more evenly than dice do: each row covers each range, and pairs of
them, with few takes.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ledpi.core.errors import ConfigError, install_command
from ledpi.core.records import Floats

TAKES = 400  # of a row, if the command line does not say
TAKES_A_CAMERA = 4  # a recording has one camera; this many takes of a row share it


@dataclass(frozen=True, slots=True, kw_only=True)
class WildRow:
    """A row: where the panel stands, and which frames of a take are judged."""

    distance_m: tuple[float, float]
    yaw_deg: tuple[float, float]  # to either side
    exposure_us: float = 10_000.0
    judged: range = range(1)  # of one frame it is read alone, else in the stream from frame 0 on

    @property
    def is_single(self) -> bool:
        """Tells whether a frame is read alone."""
        return self.judged.stop == 1


WILD: dict[str, WildRow] = {
    "near": WildRow(distance_m=(0.42, 1.4), yaw_deg=(0.0, 50.0)),
    "oblique": WildRow(distance_m=(0.42, 0.9), yaw_deg=(58.0, 80.0)),
    "mid": WildRow(distance_m=(1.5, 2.6), yaw_deg=(0.0, 50.0), judged=range(3, 5)),
    "far": WildRow(distance_m=(3.0, 8.0), yaw_deg=(0.0, 50.0), judged=range(3, 6)),
    "short": WildRow(distance_m=(0.42, 1.4), yaw_deg=(0.0, 50.0), exposure_us=150.0),
}


@dataclass(frozen=True, slots=True)
class Span:
    """A range, drawn from evenly, or so that each doubling in it is as frequent."""

    low: float
    high: float
    log: bool = False

    def quantile(self, share: float) -> float:
        """The value that lies `share` of the way up."""
        if self.log:
            return math.exp(math.log(self.low) + share * math.log(self.high / self.low))
        return self.low + share * (self.high - self.low)


# Levels are shares of full scale, lengths of a panel shares of a cell's pitch or, where it says side, of its side.
TAKE_SPANS: dict[str, Span] = {
    "distance": Span(0.0, 1.0),  # of the row's, in doublings
    "yaw": Span(-1.0, 1.0),  # of the row's, to either side
    "roll_deg": Span(-180.0, 180.0),
    "place_x": Span(-80.0, 80.0),  # pixels from the picture's middle, as far as the panel stays in view
    "place_y": Span(-60.0, 60.0),
    "id": Span(0.0, 1.0),
    "peak_level": Span(0.22, 1.1, log=True),  # of a bright band at the brightest point of a cell of gain 1
    "room_level": Span(0.005, 0.35),
    "room_contrast": Span(0.2, 0.95),
    "page": Span(-1.0, 1.0),  # contrast of what is painted or printed close behind the panel; below 0: nothing
    "page_spots": Span(2.0, 24.0, log=True),  # across the panel's side
    "gap": Span(0.0, 0.2),
    "equal_cells": Span(0.0, 1.0),  # a quarter: boxes side by side, with half that gap; else they meet on a lattice
    "hot_spot": Span(0.0, 0.7),
    "hot_spot_sigma": Span(0.15, 0.3),  # of the part of a cell that an LED lights
    "leds": Span(0.0, 1.0),  # half of the panels have 1 in a cell, a quarter 4, a quarter 9
    "depth": Span(-0.08, 0.08),  # below 0: none
    "wall_glow": Span(0.2, 0.7),
    "falloff": Span(0.0, 0.5),
    "gain": Span(0.0, 0.15),  # most that a cell's gain is off
    "bezel": Span(-0.6, 0.4),  # below 0: none
    "albedo": Span(0.02, 0.6),
    "frame_level": Span(-2.0, 0.8),  # of a bright frame behind, over the panel's light; below 0: none
    "frame_width": Span(0.03, 0.2),  # of the side
    "floor": Span(-1.5, 0.5),  # reflectance; below 0: none
    "floor_below": Span(0.0, 0.5),  # of the side, from the lowest corner
    "fault": Span(0.0, 1.0),  # one in sixteen has a dead cell, one in sixteen something before a side or a corner
    "hidden": Span(0.03, 0.12),  # of the side
    "hidden_level": Span(0.0, 0.3),
}
CAMERA_SPANS: dict[str, Span] = {
    "focal_px": Span(560.0, 760.0),
    "centre_x": Span(-12.0, 12.0),
    "centre_y": Span(-12.0, 12.0),
    "k1": Span(-0.12, 0.12),
    "row_time_us": Span(28.0, 36.0),
    "frame_length_rows": Span(505.0, 640.0),
    "tone": Span(0.0, 1.0),  # below half: linear
    "psf_sigma_px": Span(0.45, 1.2),
    "defocus_px": Span(0.0, 1.6),
    "full_well_e": Span(4000.0, 12_000.0, log=True),
    "read_noise_e": Span(4.0, 14.0),
}


def drawn(spans: Mapping[str, Span], row: str, seed: int, number: int) -> dict[str, float]:
    """Point `number` of a row's sequence, each coordinate in its range."""
    shares = _points(f"{row} {' '.join(spans)}", len(spans), seed, max(10, number.bit_length()))[number]
    return {name: span.quantile(share) for (name, span), share in zip(spans.items(), shares.tolist(), strict=True)}


@lru_cache(maxsize=16)
def _points(key: str, dimensions: int, seed: int, doublings: int) -> Floats:
    """(2 ** doublings, dimensions) in 0 … 1. A longer sequence begins with the shorter one."""
    try:
        from scipy.stats import qmc
    except ImportError:
        raise ConfigError(f"--suite wild: needs scipy: {install_command('suites')}") from None
    rng = np.random.default_rng((seed, zlib.crc32(key.encode())))
    return np.asarray(qmc.Sobol(dimensions, scramble=True, seed=rng).random_base2(doublings))
