"""The contract of `ledpi.camera.base.Camera`, which every kind of camera passes.

A further camera is added to OPENERS: a function that opens it, to end after FRAMES frames that are `wait_s`
seconds apart (None: as close as it can).
"""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable
from dataclasses import FrozenInstanceError, asdict
from pathlib import Path

import numpy as np
import pytest

from ledpi.camera.base import Camera
from ledpi.camera.factory import open_camera
from ledpi.config.settings import Config
from ledpi.core.records import Frame, PanelSpec, Pixels
from tests.builders import DEADLINE_S
from tests.unit.camera.test_recorded import recorded

FRAMES = 4
FAR_S = 10.0  # the longest that may be asked for: it does not come while a test waits
Opener = Callable[[Path, float | None], Camera]


def configured(source: str, **camera: object) -> Config:
    return Config.model_validate({"camera": {"source": source, **camera}, "panels": {"side_m": 0.16}})


def open_recording(folder: Path, wait_s: float | None, *, paced: bool) -> Camera:
    step_ms = 20 if wait_s is None else round(wait_s * 1000)
    take = recorded(folder / "take", [seq * step_ms for seq in range(FRAMES)])
    return open_camera(configured(f"recording:{take}"), paced=paced)


def open_simulated(folder: Path, wait_s: float | None, *, paced: bool) -> Camera:
    period = "auto" if wait_s is None else wait_s * 1e6
    return open_camera(configured("simulated", frame_duration_us=period), paced=paced, frames=FRAMES)


OPENERS: dict[str, Opener] = {
    "recording": lambda folder, wait_s: open_recording(folder, wait_s, paced=False),
    "recording paced": lambda folder, wait_s: open_recording(folder, wait_s, paced=True),
    "simulated": lambda folder, wait_s: open_simulated(folder, wait_s, paced=False),
    "simulated paced": lambda folder, wait_s: open_simulated(folder, wait_s, paced=True),
}
PACED = [name for name in OPENERS if name not in ("recording", "simulated")]


@pytest.fixture(params=OPENERS)
def camera(request: pytest.FixtureRequest, tmp_path: Path) -> Camera:
    """Each kind of camera, open."""
    return OPENERS[request.param](tmp_path, None)


def slot_for(camera: Camera) -> Pixels:
    return np.zeros((camera.info.height, camera.info.width), np.uint8)


def all_frames(camera: Camera) -> list[Frame]:
    """Reads until the end; a camera here gives frames only, as nothing is wrong with its pictures."""
    frames: list[Frame] = []
    while (got := camera.read(slot_for(camera))) is not None:
        assert isinstance(got, Frame)
        frames.append(got)
        assert len(frames) <= FRAMES
    return frames


def test_a_frame_is_a_read_only_view_of_the_given_array(camera: Camera) -> None:
    """(H, W) uint8 of the camera's size, in the caller's memory, which stays writable for the next frame."""
    slot = slot_for(camera)
    frame = camera.read(slot)
    assert isinstance(frame, Frame)
    assert frame.pixels.shape == (camera.info.height, camera.info.width)
    assert frame.pixels.dtype == np.uint8
    assert np.shares_memory(frame.pixels, slot)
    assert slot.any()
    assert not frame.pixels.flags.writeable
    assert slot.flags.writeable
    assert isinstance(camera.read(slot), Frame)  # a slot of the ring is used again and again


def test_seq_and_time_increase(camera: Camera) -> None:
    """Strictly, both, from frame to frame."""
    frames = all_frames(camera)
    assert len(frames) >= 1
    for earlier, later in itertools.pairwise(frames):
        assert later.seq > earlier.seq
        assert later.row0_readout_ns > earlier.row0_readout_ns


def test_a_frame_says_how_it_was_exposed(camera: Camera) -> None:
    """Exposure and row time are positive, and those of the camera's own description, as is the transfer."""
    info = camera.info
    for frame in all_frames(camera):
        assert frame.exposure_us > 0
        assert abs(frame.exposure_us - info.exposure_us) <= info.row_time_us
        assert frame.row_time_us == info.row_time_us > 0
        assert frame.transfer == info.transfer


def test_the_description_is_fixed(camera: Camera) -> None:
    """Stays as it was before the first frame after the last one, and cannot be changed."""
    before = camera.info
    all_frames(camera)
    assert camera.info == before
    with pytest.raises(FrozenInstanceError):
        camera.info.row_time_us = 1.0  # type: ignore[misc]
    if before.intrinsics is not None:
        assert (before.intrinsics.width, before.intrinsics.height) == (before.width, before.height)
    if camera.panel is not None:
        PanelSpec(**{key: value for key, value in asdict(camera.panel).items() if key != "dictionary"})


def test_the_host_s_clock_is_reported(camera: Camera) -> None:
    """On this machine's clock each frame's read-out has ended when it comes, and not long ago."""
    readout_ns = camera.info.height * camera.info.row_time_us * 1e3
    while (frame := camera.read(slot_for(camera))) is not None:
        assert isinstance(frame, Frame)
        age_ns = time.monotonic_ns() - (frame.row0_readout_ns + frame.host_offset_ns + readout_ns)
        assert -1000 <= age_ns < DEADLINE_S * 1e9  # 1 µs for rounding


def test_the_end_is_none_and_stays(camera: Camera) -> None:
    """After the last frame there is None, however often one asks."""
    all_frames(camera)
    assert camera.read(slot_for(camera)) is None
    assert camera.read(slot_for(camera)) is None


def test_close_is_safe_twice_and_ends_the_frames(camera: Camera) -> None:
    """A closed camera gives None."""
    assert isinstance(camera.read(slot_for(camera)), Frame)
    camera.close()
    camera.close()
    assert camera.read(slot_for(camera)) is None


@pytest.mark.parametrize("name", PACED)
def test_one_offset_relates_a_paced_clock_to_the_host_s(name: str, tmp_path: Path) -> None:
    """To CLOCK_MONOTONIC: whoever reads may reckon with it."""
    assert len({frame.host_offset_ns for frame in all_frames(OPENERS[name](tmp_path, None))}) == 1


@pytest.mark.parametrize("name", PACED)
def test_close_from_another_thread_ends_a_waiting_read(name: str, tmp_path: Path) -> None:
    """The daemon stops although no frame comes."""
    camera = OPENERS[name](tmp_path, FAR_S)
    slot = slot_for(camera)
    assert isinstance(camera.read(slot), Frame)
    got: list[object] = []
    reader = threading.Thread(target=lambda: got.append(camera.read(slot)))
    reader.start()
    time.sleep(0.1)  # so that it waits, most likely
    assert got == []
    camera.close()
    reader.join(DEADLINE_S)
    assert got == [None]
