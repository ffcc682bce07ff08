"""Fixtures that several test files need."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from tests.builders import ROOT

# The same examples in each run, however long one takes on a busy machine.
settings.register_profile("ledpi", derandomize=True, deadline=None, database=None)
settings.load_profile("ledpi")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as a shell starts what runs in the background; Ctrl-C is tested
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True, scope="session")
def _own_state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A daemon that loses its camera saves its last seconds: not in the home of who runs the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        patch.delenv("STATE_DIRECTORY", raising=False)
        yield


@pytest.fixture
def shared() -> Callable[[str], Path]:
    """A path in the folder `shared` beside the repository, as in `shared("recordings")`; skips without it."""

    def locate(relative: str) -> Path:
        path = ROOT.parent / "shared" / relative
        if not path.exists():
            pytest.skip(f"../shared/{relative} is not here")
        return path

    return locate


@pytest.fixture(scope="session", autouse=True)
def _own_taps(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Daemons of these tests offer their taps, and commands look for them, where no other process does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("run")))
        yield
