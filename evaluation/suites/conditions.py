"""The conditions of each suite, as plain values that name, draw and repeat them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from evaluation.simulated import Ripple
from evaluation.suites.wild_rows import WILD
from ledpi.config.panels import PanelSettings
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import Transfer
from ledpi.workshop.evaluate.table import PAPER_ANGLES_AT_M, PLAIN

Suite = Literal["paper", "beyond", "robustness", "decoys", "wild"]
Method = Literal["uemura", "likelihood", "stream", "aruco", "apriltag", "ledpi", "oracle"]
METHODS: tuple[Method, ...] = ("uemura", "likelihood", "stream", "aruco", "apriltag")
WILD_METHODS: tuple[Method, ...] = ("ledpi", "oracle", "aruco")  # ledpi: likelihood or stream as the row asks
PRINTED: tuple[Literal["aruco", "apriltag"], ...] = ("aruco", "apriltag")

# Where a panel fills half the picture, where a single frame has light to spare, and where it has not.
ROBUSTNESS_DISTANCES_M = (0.45, 1.0, 3.0)
PLACES: dict[str, tuple[tuple[float, float], ...]] = {  # distance in m, angle in degrees
    "paper": (
        *((round(0.2 * step, 1), 0.0) for step in range(2, 11)),
        *((PAPER_ANGLES_AT_M, angle) for angle in (-70.0, -45.0, -20.0, 20.0, 45.0, 70.0)),
    ),
    "beyond": (
        *((distance, 0.0) for distance in (3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)),
        *((PAPER_ANGLES_AT_M, angle) for angle in (-80.0, 80.0)),
    ),
    "robustness": tuple((distance, 0.0) for distance in ROBUSTNESS_DISTANCES_M),
    "decoys": (),
}
# Asked for; the sensor rounds down to whole rows. Robustness has other exposures among its cases.
EXPOSURES_US: dict[str, tuple[float, ...]] = {
    "paper": (10_000.0, 150.0),
    "beyond": (10_000.0, 150.0),
    "robustness": (10_000.0,),
    "decoys": (10_000.0, 150.0),
}

DECOYS = (
    "lamps",  # discs and rectangles, steady, some too bright
    "windows",  # large bright rectangles
    "window_grids",  # with bars, from 2 × 2 to 6 × 6 panes
    "pwm_lights",  # either of these, switched at 100 to 20,000 Hz with duty 0.1 to 0.9
    "single_class",  # panels all of whose cells blink alike
    "near_words",  # panels with two or more cells that differ from every word
    "mirrored",  # panels that show a word's mirror image, unless that is a word too
    "parts",  # panels of which two cells to half of them are lit
    "dead",  # panels that are dark, or lit without blinking
    "hidden_strip",  # near-words, with a strip along one side hidden
    "dead_cell",  # panels with a dark cell, of whose others two or more differ from every word
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Variation:
    """The way in which a robustness case departs from the plain panel. Levels are shares of the sensor's full scale."""

    peak_level: tuple[float, float] = (0.35, 0.7)  # drawn from; of a bright band at the middle of a cell of gain 1
    room_level: tuple[float, float] = (0.04, 0.15)  # drawn from
    gain_deviation: float = 0.05  # standard deviation of the cells' gains
    hot_spot: float = 0.2  # share of the LED that shines through the diffuser
    hot_spot_sigma: float = 0.2  # its width, in cells
    falloff: float = 0.2  # how much darker a cell's corner is than its middle
    gap: float = 0.06  # dark wall between cells, share of a cell
    oscillator_error: float = 0.0  # relative; either class off by so much, up or down
    search_frequencies: bool = False  # who reads it is told to
    row_time_us: float | None = None  # the sensor's; None: 33.67 µs
    frame_period_us: float | None = None  # None: as the daemon would choose it
    reported_row_time: float = 1.0  # what the driver says of row time and exposure, over the truth
    exposure_us: float | None = None  # in place of the run's own exposures
    speed_m_s: float = 0.0  # of the camera, up to; along the floor, in any direction
    turn_rad_s: float = 0.0  # of the camera about its vertical axis, up to
    panels: int = 1
    dead_cells: int = 0
    hidden: Literal["", "corner", "edge"] = ""
    hidden_share: float = 0.12  # of the panel's side
    lamps: int = 0  # other lights in view
    room_ripple: Ripple | None = None  # of the light in the room, and of lamps
    on_a_page: bool = False  # without a bezel, on paper with black spots
    touching: int = 0  # sides that something bright touches; then there is no bezel
    bezel: Literal["black", "none", "bright", "white"] = "black"  # white: as bright as the cells
    equal_cells: bool = False  # no lattice of walls: cells at the rim are no larger than the others
    tone_contrast: float = 0.0  # of the camera's processor, beyond sRGB
    sharpening: float = 0.0


VARIATIONS: dict[str, Variation] = {
    PLAIN: Variation(),
    "peak level 0.15": Variation(peak_level=(0.15, 0.15), room_level=(0.02, 0.06)),
    "peak level 0.85": Variation(peak_level=(0.85, 0.85)),
    "gains uneven by 15 %": Variation(gain_deviation=0.15),
    "bare LEDs, hot spots": Variation(hot_spot=0.75, hot_spot_sigma=0.16),
    "no walls between cells": Variation(gap=0.0),
    "thick walls, 12 % of a cell": Variation(gap=0.12),
    "oscillators off by 1 %": Variation(oscillator_error=0.01, search_frequencies=True),
    # At 58.333 MHz: rows of 31.75 µs, frames of 16.0 ms, in which 1250 Hz advances by 20.00 cycles, 2450 Hz by 39.2.
    "frames of 16 ms, one phase freezes": Variation(row_time_us=1852 / 58.333333, frame_period_us=16_000.0),
    # 25.00 cycles of 1250 Hz, 49.00 of 2450 Hz: every frame shows the same.
    "frames of 20 ms, both phases freeze": Variation(frame_period_us=20_000.0),
    "frames of 25 ms": Variation(frame_period_us=25_000.0),
    "frames of 33 ms": Variation(frame_period_us=33_333.0),
    "row time misreported by 6 %": Variation(row_time_us=1852 / 58.333333, reported_row_time=58.333333 / 55.0),
    "driving": Variation(speed_m_s=1.0, turn_rad_s=0.5),
    "two panels": Variation(panels=2),
    "one dead cell": Variation(dead_cells=1),
    "a corner hidden": Variation(hidden="corner"),
    "an edge hidden": Variation(hidden="edge"),
    # The wall's brightest spots at 0.3 to 0.5, panels not much above.
    "bright room": Variation(room_level=(0.2, 0.3), peak_level=(0.5, 0.85)),
    # The same wall up to the lit cells.
    "bright room, no bezel": Variation(room_level=(0.2, 0.3), peak_level=(0.5, 0.85), bezel="none"),
    "in a bright frame": Variation(bezel="bright"),
    # Neither walls nor anything else shows where cells end, nor where the panel does.
    "even cells in a white frame": Variation(bezel="white", gap=0.0, hot_spot=0.0, falloff=0.0),
    # As four boxes side by side, with boards between them.
    "cells of one size": Variation(equal_cells=True, gap=0.1),
    "sharpened, with a contrast curve": Variation(tone_contrast=0.7, sharpening=1.0),
    "other lamps": Variation(lamps=4),
    # What touches the lit cells is black here and white there, in spots of half a cell: letters, tiles, a cable.
    "on a printed page": Variation(on_a_page=True),
    # Windows, sheets, lamps: from far darker than the cells to as bright, along all of a side or a part.
    "touched by something bright": Variation(touching=2),
    # Twice the mains' frequency, as deep as poor LED lamps do it. 100 Hz vanish at 10 ms; 120 Hz keep 16 %.
    "mains flicker, 50 Hz": Variation(room_ripple=Ripple(frequency_hz=100.0, depth=0.6), lamps=2),
    "mains flicker, 60 Hz": Variation(room_ripple=Ripple(frequency_hz=120.0, depth=0.6), lamps=2),
    "exposure 500 µs": Variation(exposure_us=500.0),
    "exposure 2 ms": Variation(exposure_us=2_000.0),
    "exposure 5 ms": Variation(exposure_us=5_000.0),
}

# Of decoys: what is hidden or dark, in a plain room.
DECOY_VARIATIONS: dict[str, Variation] = {
    "hidden_strip": Variation(hidden="edge"),
    "dead_cell": Variation(dead_cells=1),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """One row of a table. Decoys and the suite wild have no distance and no angle: each stands somewhere."""

    suite: Suite
    case: str = PLAIN  # a key of VARIATIONS, one of DECOYS, or a key of WILD
    distance_m: float | None = None
    angle_deg: float | None = None  # between the panel's normal and the line of sight, about the vertical axis
    exposure_us: float = 10_000.0
    transfer: Transfer | Literal["any"] = "srgb"  # any: drawn for each camera
    any_roll: bool = True  # False: within ±3°, as hung by hand

    @property
    def name(self) -> str:
        """One of a kind, and readable."""
        place = "" if self.distance_m is None else f", {self.distance_m:g} m, {self.angle_deg:g}°"
        roll = ", any roll" if self.any_roll else ""
        return f"{self.suite}: {self.case}{place}{roll}, {self.exposure_us:g} µs, {self.transfer}"

    @property
    def variation(self) -> Variation:
        """Decoys stand in a plain room."""
        return (DECOY_VARIATIONS if self.suite == "decoys" else VARIATIONS).get(self.case, VARIATIONS[PLAIN])

    def panels_of(self, panels: PanelSettings) -> PanelSettings:
        """The panels as their reader is told of them. Of decoys every ID exists: each false one counts."""
        if self.suite == "decoys":
            return panels.model_copy(update={"ids": tuple(range(len(load_dictionary(panels.dictionary).codewords)))})
        return panels.model_copy(update={"search_frequencies": True}) if self.variation.search_frequencies else panels


def suite_conditions(
    suite: Suite,
    *,
    distances_m: Sequence[float] = (),
    angles_deg: Sequence[float] = (),
    exposures_us: Sequence[float] = (),
    transfers: Sequence[Transfer],
    any_roll: bool,
) -> Iterator[Condition]:
    """The conditions of a suite, in the tables' order. Distances, angles, exposures replace its own, if given.

    A case that has its own exposure comes once for each of the run's. The suite wild draws all of these itself.
    """
    if suite == "wild":
        for case, row in WILD.items():
            yield Condition(suite=suite, case=case, exposure_us=row.exposure_us, transfer="any")
        return
    places = PLACES[suite]
    if distances_m or angles_deg:
        own_m = ROBUSTNESS_DISTANCES_M if suite == "robustness" else (PAPER_ANGLES_AT_M,)
        places = tuple(itertools.product(distances_m or own_m, angles_deg or (0.0,)))
    for transfer, exposure_us in itertools.product(transfers, exposures_us or EXPOSURES_US[suite]):
        if suite == "decoys":
            common = Condition(suite=suite, exposure_us=exposure_us, transfer=transfer)
            yield from (replace(common, case=kind) for kind in DECOYS)
            continue
        for case in VARIATIONS if suite == "robustness" else (PLAIN,):
            own_us = VARIATIONS[case].exposure_us or exposure_us
            common = Condition(suite=suite, case=case, exposure_us=own_us, transfer=transfer, any_roll=any_roll)
            yield from (replace(common, distance_m=distance_m, angle_deg=angle_deg) for distance_m, angle_deg in places)
