"""From `camera.source` to a camera, and the settings that reach it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ledpi.camera.factory import open_camera
from ledpi.camera.recorded import RecordingCamera
from ledpi.camera.recording.writer import RecordingWriter
from ledpi.config.settings import Config
from ledpi.core.errors import CameraError
from ledpi.core.records import CameraInfo, Frame, PanelSpec
from tests.builders import ROOT


def config(source: str, **camera: object) -> Config:
    return Config.model_validate({"camera": {"source": source, **camera}, "panels": {"side_m": 0.16}})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A recording of two frames with 31.75 µs rows, linear."""
    source = CameraInfo(width=8, height=6, exposure_us=150.0, row_time_us=31.75, transfer="linear")
    panel = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
    with RecordingWriter(tmp_path / "take", camera=source, dictionary="DICT_4X4_50", panel=panel) as recorder:
        for seq in range(2):
            frame = Frame(
                pixels=np.zeros((6, 8), np.uint8),
                seq=seq,
                row0_readout_ns=seq,
                exposure_us=150.0,
                row_time_us=31.75,
                transfer="linear",
            )
            recorder.write(frame)
    return tmp_path / "take"


def test_a_recording_s_values_override_the_configuration_s(folder: Path) -> None:
    """Row time and transfer of the configuration do not reach a recording, which knows its own."""
    camera = open_camera(config(f"recording:{folder}", row_time_us=20.0, transfer="srgb"), paced=False)
    assert isinstance(camera, RecordingCamera)
    assert (camera.info.row_time_us, camera.info.transfer) == (31.75, "linear")


def test_a_number_of_frames_repeats_a_shorter_recording(folder: Path) -> None:
    """Two recorded frames, five asked for: five come, then the end. Without a number: two."""
    for frames, expected in [(5, 5), (1, 1), (None, 2)]:
        camera = open_camera(config(f"recording:{folder}"), paced=False, frames=frames)
        into = np.zeros((6, 8), np.uint8)
        assert sum(1 for _ in iter(lambda: camera.read(into), None)) == expected  # noqa: B023


@pytest.mark.parametrize("options", [{"paced": False}, {"frames": 3}])
def test_a_device_has_its_own_pace_and_no_end(options: dict[str, int]) -> None:
    """Refuses for a device what only a replay can do, rather than pass it over in silence."""
    with pytest.raises(CameraError, match=r"^--frames, --unpaced: only for .*, not picamera2$"):
        open_camera(config("picamera2"), **options)  # type: ignore[arg-type]


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
