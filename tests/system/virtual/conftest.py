"""Tests with the real picamera2 and libcamera, on libcamera's virtual camera.

They run in an environment of their own: `scripts/virtual-camera -rs` makes it (Debian 12, root) and runs them.
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

if TYPE_CHECKING:
    from tests.builders.virtual_picamera2 import Behaviour

os.environ["LIBCAMERA_LOG_LEVELS"] = "*:FATAL"  # it names each control that the virtual camera does not know

if importlib.util.find_spec("libcamera") is None:
    collect_ignore_glob = ["test_[!h]*.py"]


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("filterwarnings", "ignore:setDaemon:DeprecationWarning")  # picamera2's event loop


@pytest.fixture
def behaviour(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Behaviour]:
    """A virtual OV5647 that shows nine grey pictures, each of another brightness; unplugged after the test."""
    from tests.builders.virtual_picamera2 import Behaviour, show, unplug, use

    show(tmp_path / "grey", [np.full((480, 640), 20 * number, np.uint8) for number in range(1, 10)])
    behaviour = Behaviour()
    use(behaviour, monkeypatch.setattr)
    yield behaviour
    behaviour.stalled.clear()
    for camera in behaviour.opened:
        camera.close()
    unplug()
