"""A design in words: faults of a pair, the table of the best pairs, why they are, and the lines for config.yaml."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ledpi.camera.timing import choose_frame_length_rows, frame_duration_us
from ledpi.core.codewords import Dictionary
from ledpi.core.records import Phase
from ledpi.core.shutter import contrast, phase_advance_cycles
from ledpi.core.wording import counted
from ledpi.workshop.panel.design import ENOUGH_NATS, FROZEN_CYCLES, Proposal, Task
from ledpi.workshop.panel.frequencies import NULL_SHARE, half_period, nearest_lobe_hz, null_share, off_mains_hz
from ledpi.workshop.panel.information import STREAM_FRAMES
from ledpi.workshop.panel.reach import RELIABLE, Reach


def summary_line(verb: str, named: tuple[Proposal, Reach], present: tuple[Proposal, Reach] | None = None) -> str:
    """Says what a person wants to know first, as in `best are 1253.33 and 2557.54 Hz: …`."""
    text = f"{verb} {_hz(named[0])}: a panel is read {_read_to(named[1])}"
    if present is not None:
        text += f"; the present {_hz(present[0])}: {_read_to(present[1])}"
    return text


def _hz(proposal: Proposal) -> str:
    return f"{proposal.black_hz:.2f} Hz (black cells) and {proposal.white_hz:.2f} Hz (white)"


def _read_to(reach: Reach) -> str:
    alone, stream = (_metres(reach.range_m(chances)) for chances in (reach.alone, reach.stream))
    return f"to {alone} in a single picture, to {stream} within {STREAM_FRAMES}".replace("to nowhere", "nowhere")


def task_text(task: Task) -> str:
    """Says what was asked, and what the exposure does to lamps on the mains."""
    sensor = task.sensor
    through = [f"{100 * abs(np.sinc(hz * sensor.exposure_us * 1e-6)):.0f} % at {hz} Hz" for hz in (100, 120)]
    return "\n".join(
        [
            f"exposure {sensor.exposure_us:.0f} µs ({round(sensor.exposure_us / sensor.row_time_us)} rows of "
            f"{sensor.row_time_us:.2f} µs); panel {1e3 * task.side_m:.0f} mm, {task.cells} × {task.cells} cells; "
            f"oscillators within ± {1e6 * task.tolerance:g} ppm; {task.flicker.value} flicker: from "
            f"{task.flicker.lowest_hz:g} Hz",
            f"the exposure lets through {through[0]} and {through[1]} of other lamps' flicker",
        ]
    )


def table(task: Task, rows: Sequence[tuple[str, Proposal, Reach]]) -> str:
    """One line a proposal, named by the first of each row."""
    far_m = task.distances_m[-1]
    head = (
        f"{'':9}{'black':>9}{'white':>9}  {'frame period':>17}  {'depth of bands':>14}  {'advance a frame':>15}  "
        f"{'periods a cell':>14}  {f'nats at {far_m:g} m':>14}  {'off mains':>9}  "
        f"{f'read alone, of {STREAM_FRAMES}':>16}"
    )
    return "\n".join([head, *(_line(task, *row) for row in rows)])


def _line(task: Task, name: str, proposal: Proposal, reach: Reach) -> str:
    pair = (proposal.black_hz, proposal.white_hz)
    period_us = proposal.frame_length_rows * task.sensor.row_time_us
    depth = [f"{100 * task.own_light * contrast(hz, task.sensor.exposure_us, task.duty):.1f}" for hz in pair]
    advance = [f"{phase_advance_cycles(hz, period_us):+.2f}" for hz in pair]
    periods = [f"{task.periods_in_a_cell(hz, task.distances_m[-1]):.2f}" for hz in pair]
    mains = min(off_mains_hz(hz) for hz in pair)
    ranges = [_metres(reach.range_m(chances)) for chances in (reach.alone, reach.stream)]
    return (
        f"{name:9}{pair[0]:9.2f}{pair[1]:9.2f}  {f'{period_us:.0f} µs {proposal.frame_length_rows} rows':>17}  "
        f"{' and '.join(depth) + ' %':>14}  {' and '.join(advance):>15}  "
        f"{' and '.join(periods):>14}  "
        f"{f'{proposal.alone[-1]:.2g} / {proposal.stream[-1]:.1f}':>14}  {f'{mains:.0f} Hz':>9}  "
        f"{', '.join(ranges):>16}"
    )


def _metres(range_m: float | None) -> str:
    return "nowhere" if range_m is None else f"{range_m:.1f} m"


def legend() -> str:
    """Says what the columns mean."""
    sentences = (
        "depth of bands: peak to peak over the mean, at this exposure. advance: in cycles; near 0 a class is frozen. "
        "periods a cell: of the bands, at the farthest distance. nats: how clearly a cell shows its class there, in "
        f"one frame / in {STREAM_FRAMES}; {ENOUGH_NATS:g} are enough. off mains: from the nearest harmonic of 100 or "
        f"120 Hz. read: the distance to which {100 * RELIABLE:.0f} % of panels are read, by the decoder's own error "
        "model; inexact corners make it less."
    )
    return "\n".join(textwrap.wrap(sentences, 118))


def antiphase_text(proposal: Proposal, reach: Reach, best: Reach, dictionary: Dictionary) -> str:
    """Says what an antiphase panel would be worth beside the best pair, and what it costs."""
    own, pair = ([_metres(r.range_m(chances)) for chances in (r.alone, r.stream)] for r in (reach, best))
    readable = dictionary.readable_ids("antiphase")
    ids = (
        "all IDs"
        if len(readable) == len(dictionary.codewords)
        else f"{len(readable)} of {len(dictionary.codewords)} IDs"
    )
    sentences = (
        f"antiphase: both classes at {proposal.black_hz:.2f} Hz, half a cycle apart. Such a panel is read alone to "
        f"{own[0]}, of {STREAM_FRAMES} to {own[1]} (best pair: {pair[0]}, {pair[1]}). A codeword and its negative look "
        "alike then. "
        f"So {ids} of {dictionary.name} can be used, and {counted(dictionary.correctable_cells('antiphase'), 'cell')} "
        f"of a panel may be wrong or dead instead of {dictionary.correctable_cells()}."
    )
    return "\n".join(textwrap.wrap(sentences, 118))


def config_lines(task: Task, proposal: Proposal, dictionary: str, exposure_us: float) -> str:
    """The lines for config.yaml; a whole configuration by themselves. `exposure_us` is what is asked of the camera."""
    rows, row_time_us = proposal.frame_length_rows, task.sensor.row_time_us
    duration_us = frame_duration_us(rows, row_time_us)
    return (
        "camera:\n"
        f"  exposure_us: {exposure_us:g}           # {task.sensor.exposure_us:.0f} in whole rows\n"
        f"  frame_duration_us: {duration_us}     # {rows} rows of {row_time_us:.2f} µs; both classes' bands move\n"
        "panels:\n"
        f"  dictionary: {dictionary}\n"
        f"  side_m: {task.side_m:g}\n"
        f"  black_hz: {proposal.black_hz:.2f}\n"
        f"  white_hz: {proposal.white_hz:.2f}\n"
        f"  duty: {task.duty:g}\n" + ("  phase: antiphase\n" if proposal.black_hz == proposal.white_hz else "")
    )


_NEAR_MAINS_HZ = 5.0


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing to know of a pair."""

    unusable: bool  # else it is only worth knowing
    text: str


def findings(
    task: Task, black_hz: float, white_hz: float, frame_length_rows: int, phase: Phase = "free"
) -> list[Finding]:
    """All that speaks against the pair, the worst first; empty where nothing does."""
    found = []
    both = phase == "antiphase" and black_hz == white_hz
    classes = [("both", black_hz)] if both else [("black", black_hz), ("white", white_hz)]
    for name, hz in classes:
        found += [Finding(True, f"{name}, {hz:g} Hz: {text}") for text in _frequency_findings(task, hz)]
    if phase == "free":
        found += [Finding(True, text) for text in _pair_findings(task, black_hz, white_hz)]
    elif not both:
        found.append(Finding(True, f"in antiphase both classes blink alike, not at {black_hz:g} and {white_hz:g} Hz"))
    found += [Finding(True, text) for text in _frozen(task, [hz for _, hz in classes], frame_length_rows)]
    for name, hz in classes:
        if off_mains_hz(hz) < _NEAR_MAINS_HZ:
            found.append(
                Finding(
                    False,
                    f"{name}, {hz:g} Hz: {off_mains_hz(hz):.0f} Hz from a harmonic of the mains' 100 or 120 Hz; a lamp "
                    "that is switched rather than smoothed may show there",
                )
            )
    return found


def _frequency_findings(task: Task, hz: float) -> list[str]:
    exposure_us, lowest_hz = task.sensor.exposure_us, task.flicker.lowest_hz
    near_hz = nearest_lobe_hz(hz, exposure_us, lowest_hz)
    better = f"the nearest good one is {near_hz:.2f} Hz"
    if null_share(near_hz, exposure_us, task.tolerance) < NULL_SHARE:
        better = f"none near by is good with oscillators within ± {1e6 * task.tolerance:g} ppm; a crystal's are 100"
    found = []
    if hz < lowest_hz:
        found.append(
            f"flickers: light that goes fully on and off is {task.flicker.value} (IEEE 1789) from {lowest_hz:g} Hz on; "
            + better
        )
    share = null_share(hz, exposure_us, task.tolerance)
    if share < NULL_SHARE:
        cycles = hz * exposure_us * 1e-6
        spread = f" ± {task.tolerance * cycles:.2g}" if task.tolerance * cycles >= 0.01 else ""
        found.append(
            f"on a null: the exposure of {exposure_us:.0f} µs holds {cycles:.2f}{spread} of its cycles, and whole ones "
            f"leave no bands ({100 * contrast(hz, exposure_us, task.duty):.1f} % deep here); {better}"
        )
    if hz * task.sensor.row_time_us * 1e-6 >= 0.5:
        found.append(
            f"too fast: its bands are {0.5e6 / hz / task.sensor.row_time_us:.2f} rows high, less than one; must be "
            f"below {0.5e6 / task.sensor.row_time_us:.0f} Hz"
        )
    try:
        half_period(hz)
    except ValueError as error:
        found.append(f"the driver's timer cannot make it: {error}")
    return found


def _pair_findings(task: Task, black_hz: float, white_hz: float) -> list[str]:
    least_hz = task.least_apart_hz(black_hz, white_hz)
    if abs(white_hz - black_hz) > least_hz:
        return []
    good = nearest_lobe_hz(2 * black_hz, task.sensor.exposure_us, task.flicker.lowest_hz)
    return [
        f"{black_hz:g} and {white_hz:g} Hz coincide: their bands look alike; must be {least_hz:.0f} Hz apart at the "
        "very least, to drift by a cycle over a whole picture and whatever the oscillators do; "
        f"with {black_hz:g} Hz a good one is {good:.2f} Hz"
    ]


def _frozen(task: Task, frequencies_hz: list[float], rows: int) -> list[str]:
    """A class whose bands stand still from frame to frame, and the period that would move them."""
    row_time_us = task.sensor.row_time_us
    period_us = rows * row_time_us
    frozen = [hz for hz in frequencies_hz if abs(phase_advance_cycles(hz, period_us)) < FROZEN_CYCLES]
    if not frozen:
        return []
    try:
        moving = choose_frame_length_rows(shortest_rows=rows, row_time_us=row_time_us, frequencies_hz=frequencies_hz)
        moving_us = moving * row_time_us
        cure = f"a frame of {moving_us:.0f} µs ({moving} rows, {1e6 / moving_us:.2f} fps) moves both"
    except ValueError:
        cure = "no frame period moves both"
    return [
        f"{hz:g} Hz is frozen at {1e6 / period_us:.3f} fps: it advances by {hz * period_us * 1e-6:.4f} cycles a frame, "
        f"so every frame shows the same bands, and further frames tell nothing new of its cells; {cure}"
        for hz in frozen
    ]
