"""One take of a condition as a recording, to look at with the other commands what a method missed or made up."""

from __future__ import annotations

from pathlib import Path

from evaluation.suites.conditions import Condition
from evaluation.suites.draw import draw_take
from evaluation.suites.units import photographed
from ledpi.config.panels import PanelSettings
from ledpi.recording.writer import RecordingWriter
from ledpi.simulate.sensor import sensor_info
from ledpi.simulate.truth import scene_truth
from ledpi.tools.evaluate.reading import FRAMES_A_TAKE


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
