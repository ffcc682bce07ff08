"""What several test files need."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.builders import ROOT

# Their tests tell how late a daemon is: no other test may take the processor meanwhile.
ALONE = ("demo", "faults", "liveness", "run", "wire_age")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """`scripts/test` runs these after the others, one by one."""
    for item in items:
        if item.path.stem.removeprefix("test_") in ALONE:
            item.add_marker("alone")


@pytest.fixture
def shared() -> Callable[[str], Path]:
    """A path in the folder `shared` beside the repository, as in `shared("recordings")`; skips without it."""

    def locate(relative: str) -> Path:
        path = ROOT.parent / "shared" / relative
        if not path.exists():
            pytest.skip(f"../shared/{relative} is not here")
        return path

    return locate
