"""Takes as recordings with truth: one to look at with the other commands, or all of `wild` to try a decoder on."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from evaluation.suites.conditions import Condition
from evaluation.suites.draw import draw_take
from evaluation.suites.units import photographed
from evaluation.suites.wild import draw_camera, draw_wild
from evaluation.suites.wild_rows import TAKE_SPANS, TAKES_A_CAMERA, WILD, drawn
from ledpi.camera.recording.writer import RecordingWriter
from ledpi.camera.simulate.render import scene_truth
from ledpi.camera.simulate.sensor import sensor_info
from ledpi.config.panels import PanelSettings
from ledpi.workshop.evaluate.scoring import FRAMES_A_TAKE

BETWEEN_TAKES_NS = 2_000_000_000  # tracks do not survive half a second
DRAWN_FILE = "drawn.jsonl"  # what was drawn for each take, to look up what a decoder loses


def write_take(
    out: Path, condition: Condition, panels: PanelSettings, seed: int, number: int, frame_duration_us: float | None
) -> None:
    """All frames of the take, with truth. Raises RecordingError where `out` cannot be written."""
    take = draw_take(condition, panels, seed, number, frame_duration_us)
    info = sensor_info(take.scene.sensor, take.reported_row_time)
    writer = RecordingWriter(
        out,
        camera=info,
        dictionary=panels.dictionary,
        panel=panels.spec(),
        note=f"evaluation.suites, seed {seed}, take {number} of {condition.name}",
    )
    with writer:
        for frame in photographed(take, take.scene, FRAMES_A_TAKE):
            writer.write(frame, scene_truth(take.scene, frame.seq))


def keep_wild(
    out: Path, row: str, panels: PanelSettings, *, seed: int, takes: int, advance: Callable[[int], None]
) -> None:
    """Takes 0 to `takes` of a row, as OUT/row00, OUT/row01 …: one recording for each camera.

    A take's frames are those until the last that is judged; the next take follows two seconds later. Raises
    RecordingError where a folder cannot be written.
    """
    for first in range(0, takes, TAKES_A_CAMERA):
        folder, numbers = out / f"{row}{first // TAKES_A_CAMERA:02d}", range(first, min(first + TAKES_A_CAMERA, takes))
        writer = RecordingWriter(
            folder,
            camera=sensor_info(draw_camera(row, seed, first)),
            dictionary=panels.dictionary,
            panel=panels.spec(),
            note=f"evaluation.suites --suite wild, seed {seed}, {row}, takes from {first} on",
        )
        with writer:
            for number in numbers:
                _write(writer, row, panels, seed, number)
                advance(1)
        lines = [json.dumps({"take": number, **_rounded(drawn(TAKE_SPANS, row, seed, number))}) for number in numbers]
        (folder / DRAWN_FILE).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _write(writer: RecordingWriter, row: str, panels: PanelSettings, seed: int, number: int) -> None:
    take, frames = draw_wild(row, panels, seed, number), WILD[row].judged.stop
    place = number % TAKES_A_CAMERA
    for frame in photographed(take, take.scene, frames):
        truth = scene_truth(take.scene, frame.seq)
        later_ns = place * BETWEEN_TAKES_NS
        shifted = replace(frame, seq=place * frames + frame.seq, row0_readout_ns=frame.row0_readout_ns + later_ns)
        writer.write(shifted, truth)


def _rounded(values: dict[str, float]) -> dict[str, float]:
    return {name: float(f"{value:.4g}") for name, value in values.items()}
