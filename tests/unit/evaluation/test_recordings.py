"""Rates on recordings with truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from evaluation.accuracy.recordings import measure, pipeline_for
from ledpi.camera.recording.reader import TruthMarker, load_recording
from ledpi.workshop.evaluate.table import frame_of
from tests.builders.daemon import write_recording


def test_photographs_whose_corners_alone_are_known_are_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Corners are compared; there is no true pose to compare with."""
    write_recording(tmp_path / "take", 1)
    recording = load_recording(tmp_path / "take")
    frame = frame_of(recording, recording.frames[0])
    (marker,) = pipeline_for(recording, stream=False).decode(frame).markers
    true = TruthMarker(id=7, corners_px=marker.detection.corners_px + 0.5, camera_from_marker=None)
    measure(replace(recording, truth={frame.seq: (true,)}), "take", stream=False)
    assert "read    1/1    wrong 0  corners  0.707 px  position      – %" in capsys.readouterr().out
