"""What several test files need."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.builders import ROOT


@pytest.fixture
def shared() -> Callable[[str], Path]:
    """A path in the folder `shared` beside the repository, as in `shared("recordings")`; skips without it."""

    def locate(relative: str) -> Path:
        path = ROOT.parent / "shared" / relative
        if not path.exists():
            pytest.skip(f"../shared/{relative} is not here")
        return path

    return locate
