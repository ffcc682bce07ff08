"""The simulated camera: paced like a sensor, or as fast as it is read."""

from __future__ import annotations

import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from ledpi.camera.base import Camera
from ledpi.camera.simulate.render import Renderer
from ledpi.camera.simulate.scene import Scene
from ledpi.camera.simulated import SimulatedCamera, open_simulated
from ledpi.config.settings import Config, load_config
from ledpi.core.errors import CameraError, ConfigError
from ledpi.core.records import Frame, Pixels
from tests.builders.simulate import LENS, panel, sensor, standing

PERIOD_S = 504 * 33.67e-6
SCENE = Scene(sensor=sensor(), panels=(panel(standing()),))


def buffer() -> Pixels:
    return np.empty((480, 640), np.uint8)


def frame_of(camera: Camera, into: Pixels) -> Frame:
    frame = camera.read(into)
    assert isinstance(frame, Frame)
    return frame


def config(*overrides: str) -> Config:
    return load_config(None, ("panels.side_m=0.16", "camera.source=simulated", *overrides))


def test_unpaced_it_delivers_every_frame_and_then_none() -> None:
    """`frames` frames with their numbers and read-out times 504 rows apart, then None."""
    camera = SimulatedCamera(SCENE, seed=1, paced=False, frames=4)
    frames = [frame_of(camera, buffer()) for _ in range(4)]
    assert [frame.seq for frame in frames] == [0, 1, 2, 3]
    np.testing.assert_allclose(np.diff([f.row0_readout_ns for f in frames]), 504 * 33_670, atol=1)
    assert camera.read(buffer()) is None


def test_it_may_begin_with_a_later_frame() -> None:
    """Whose picture and time are as if those before it had been read."""
    camera, later = SimulatedCamera(SCENE, seed=1, paced=False), SimulatedCamera(SCENE, seed=1, paced=False, first=2)
    *_, third = (frame_of(camera, buffer()) for _ in range(3))
    began = frame_of(later, buffer())
    assert (began.seq, began.row0_readout_ns) == (third.seq, third.row0_readout_ns)
    np.testing.assert_array_equal(began.pixels, third.pixels)


def test_frames_are_the_renderers_in_the_readers_array() -> None:
    """The picture lands in the array that was given; its values are the scene's."""
    into, expected = buffer(), buffer()
    camera = SimulatedCamera(SCENE, seed=1, paced=False)
    Renderer(SCENE, seed=1).render(0, expected)
    info, frame = camera.info, frame_of(camera, into)
    np.testing.assert_array_equal(into, expected)
    assert (info.height, info.width) == frame.pixels.shape
    assert (info.exposure_us, info.row_time_us, info.transfer) == (9967.0, 33.67, "srgb")
    assert (frame.exposure_us, frame.row_time_us, frame.transfer) == (9967.0, 33.67, "srgb")
    assert (info.frame_length_rows, info.intrinsics) == (504, LENS)
    assert [t.id for t in camera.truth(1000)] == [7]  # of any frame
    np.testing.assert_allclose(camera.truth(0)[0].camera_from_marker.position_m, [0, 0, 1])


def test_a_slow_reader_misses_frames() -> None:
    """Who comes ten periods late gets the newest frame that exists, and the gap is counted; at the end the last one."""
    camera, into = SimulatedCamera(SCENE, seed=1, paced=True), buffer()
    first = frame_of(camera, into)
    time.sleep(10.5 * PERIOD_S)
    late = frame_of(camera, into)
    assert late.seq >= first.seq + 10
    assert camera.missed == late.seq - first.seq - 1
    assert frame_of(camera, into).seq > late.seq
    short = SimulatedCamera(SCENE, seed=1, paced=True, frames=4)
    assert frame_of(short, into).seq == 0
    time.sleep(10 * PERIOD_S)
    assert frame_of(short, into).seq == 3
    assert short.read(into) is None


def test_an_array_of_another_size_is_refused() -> None:
    """Nothing is drawn into an array that does not fit."""
    with pytest.raises(CameraError, match=r"\(480, 640\), not \(240, 320\)"):
        SimulatedCamera(SCENE, seed=1, paced=False).read(np.empty((240, 320), np.uint8))


def test_the_configurations_camera_drives_past_7_and_23() -> None:
    """Both panels, as configured, with a true exposure of whole rows; an override changes the panel of its ID alone."""
    settings = ("panels.black_hz=1300", "camera.transfer=linear", "camera.row_time_us=31.75")
    camera = open_simulated(config(*settings), paced=False, frames=1)
    assert {t.id for t in camera.truth(100)} == {7, 23}
    assert camera.panel is not None
    assert (camera.panel.dictionary, camera.panel.side_m, camera.panel.black_hz) == ("DICT_4X4_50", 0.16, 1300.0)
    assert camera.info.exposure_us == pytest.approx(314 * 31.75)
    assert (camera.info.row_time_us, camera.info.transfer) == (31.75, "linear")

    def size_of_23_to_7(camera: SimulatedCamera) -> float:
        size = {t.id: np.linalg.norm(t.corners_px[1] - t.corners_px[0]) for t in camera.truth(100)}
        return float(size[23] / size[7])

    larger = open_simulated(config(*settings, "panels.overrides={23: {side_m: 0.2}}"), paced=False)
    assert size_of_23_to_7(larger) / size_of_23_to_7(camera) == pytest.approx(0.2 / 0.16, rel=0.02)


@pytest.mark.parametrize(
    ("overrides", "rows"),
    [
        ((), 507),  # 1250 Hz advances 21.34 cycles, 2450 Hz 41.83; 504 would do, were oscillators exact
        (("camera.frame_duration_us=25000",), 742),
        (("camera.exposure_us=20000",), 597),  # 593 rows of exposure, and four to spare
    ],
)
def test_the_frame_period_is_whole_rows(overrides: tuple[str, ...], rows: int) -> None:
    """The sensor's shortest, or as configured, but never shorter than the exposure."""
    overrides += () if "camera.exposure_us=20000" not in overrides else ("camera.frame_duration_us=1000",)
    assert open_simulated(config(*overrides), paced=False).info.frame_length_rows == rows


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        (("camera.exposure_us=3000000", "camera.frame_duration_us=4000000"), "exposure_us"),
        (("camera.width=32",), r"^camera: fy: must be 48 to 48000 pixels for pictures of 32 × 480"),
    ],
)
def test_an_impossible_sensor_is_a_configuration_error(overrides: tuple[str, ...], says: str) -> None:
    """An exposure that no frame holds; a picture as narrow as its focal length is short could not be read again."""
    with pytest.raises(ConfigError, match=says):
        open_simulated(config(*overrides), paced=False)


def test_a_dictionary_without_the_drives_ids_is_a_configuration_error(tmp_path: Path) -> None:
    """Takes a dictionary of one's own five words, for example: the remedy is another one, or another source."""
    storage = cv2.FileStorage(str(tmp_path / "words.yaml"), cv2.FILE_STORAGE_WRITE)
    cv2.aruco.extendDictionary(5, 4).writeDictionary(storage)
    storage.release()
    settings = load_config(None, ("panels.side_m=0.16", f"panels.dictionary={tmp_path / 'words.yaml'}"))
    with pytest.raises(ConfigError, match=r"^panels\.dictionary: the simulated drive shows 7 and 23: .* IDs 0 to 4"):
        open_simulated(settings, paced=False)
