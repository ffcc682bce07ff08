"""From `camera.source` to a camera, and the settings that reach it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ledpi.camera.factory import open_camera
from ledpi.camera.recorded import RecordingCamera
from ledpi.core.errors import CameraError
from tests.builders import ROOT
from tests.unit.camera.test_contract import configured
from tests.unit.camera.test_recorded import recorded


def test_a_recording_s_values_override_the_configuration_s(tmp_path: Path) -> None:
    """Row time and transfer of the configuration do not reach a recording, which knows its own."""
    take = recorded(tmp_path / "take", [0])
    camera = open_camera(configured(f"recording:{take}", row_time_us=20.0, transfer="srgb"), paced=False)
    assert isinstance(camera, RecordingCamera)
    assert (camera.info.row_time_us, camera.info.transfer) == (100.0, "linear")


def test_a_number_of_frames_repeats_a_shorter_recording(tmp_path: Path) -> None:
    """Two recorded frames, five asked for: five come, then the end. Without a number: two."""
    take = recorded(tmp_path / "take", [0, 1])
    for frames, expected in [(5, 5), (1, 1), (None, 2)]:
        camera = open_camera(configured(f"recording:{take}"), paced=False, frames=frames)
        into = np.zeros((6, 8), np.uint8)
        assert sum(1 for _ in iter(lambda: camera.read(into), None)) == expected  # noqa: B023


@pytest.mark.parametrize("options", [{"paced": False}, {"frames": 3}])
def test_a_device_has_its_own_pace_and_no_end(options: dict[str, int]) -> None:
    """Refuses for a device what only a replay can do, rather than pass it over in silence."""
    with pytest.raises(CameraError, match=r"^--frames, --unpaced: only for .*, not picamera2$"):
        open_camera(configured("picamera2"), **options)  # type: ignore[arg-type]


@pytest.mark.slow
def test_no_device_is_imported_before_it_is_used() -> None:
    """A Pi with its camera needs no simulator, and a laptop no picamera2: the factory loads neither."""
    code = (
        "import sys, ledpi.camera.factory; "
        "print(*(m for m in sys.modules if m.startswith(('ledpi.camera.simulate', 'ledpi.camera.', 'picamera2'))))"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = ("base", "factory", "gain", "timing")
    assert sorted(done.stdout.split()) == [f"ledpi.camera.{name}" for name in loaded]
