"""Says whether the virtual camera's tests run."""

from __future__ import annotations

import importlib.util

import pytest


def test_the_virtual_camera_is_here() -> None:
    """Elsewhere this says how to enable them."""
    if importlib.util.find_spec("libcamera") is None:
        pytest.skip("the virtual camera's tests run with `scripts/virtual-camera -rs` (Debian 12, as root; minutes)")
