"""Fixtures that several test files need."""

from __future__ import annotations

import signal
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from tests.builders import ROOT
from tests.builders.waiting import limit_s

# The same examples in each run, however long one takes on a busy machine.
settings.register_profile("ledpi", derandomize=True, deadline=None, database=None)
settings.load_profile("ledpi")

LIMIT_S, SLOW_LIMIT_S = 60.0, 900.0  # of one test, on an idle machine: after it the stacks of all threads are told

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as a shell starts what runs in the background; Ctrl-C is tested
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--first-and-last",
        action="store_true",
        help="of each parametrised test only its first and its last case, but of those marked `table`",
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Gives each test its limit, and leaves cases out where the command asks for it."""
    for item in items:
        if item.get_closest_marker("timeout") is None:
            idle_s = LIMIT_S if item.get_closest_marker("slow") is None else SLOW_LIMIT_S
            item.add_marker(pytest.mark.timeout(limit_s(idle_s)))
    if config.getoption("first_and_last"):
        kept = _first_and_last(items)
        config.hook.pytest_deselected(items=[item for item in items if item not in kept])
        items[:] = [item for item in items if item in kept]


def _first_and_last(items: list[pytest.Item]) -> set[pytest.Item]:
    """Cases of one test walk the same path: planted faults that any case catches, the first or the last one does."""
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        whole = item.nodeid if item.get_closest_marker("table") else item.nodeid.partition("[")[0]
        cases.setdefault(whole, []).append(item)
    return {case for of_one in cases.values() for case in (of_one[0], of_one[-1])}


def pytest_sessionstart(session: pytest.Session) -> None:
    """xdist's own `--maxfail` lets each process finish what it was given: hundreds of tests."""
    if hasattr(session.config, "workerinput") and session.config.getvalue("maxfail"):
        session.config.pluginmanager.register(_StopTogether(session, session.config.workerinput["testrunuid"]))


class _StopTogether:
    """Ends all processes of a run after so many failures of all, bytes in a file that they share; a hang is three."""

    def __init__(self, session: pytest.Session, run: str) -> None:
        self._session, self._file = session, Path(tempfile.gettempdir()) / f"ledpi-failures-{run}"

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if not report.failed:
            return
        with self._file.open("ab") as file:
            file.write(b"x" if report.duration < LIMIT_S / 2 else b"xxx")
            if file.tell() >= self._session.config.getvalue("maxfail"):
                self._session.shouldstop = f"after {file.tell()} failures"


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


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty working directory, without a config.yaml."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def takes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder that a daemon of this test writes to."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "ledpi" / "takes"


@pytest.fixture(scope="session", autouse=True)
def _own_taps(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Daemons of these tests offer their taps, and commands look for them, where no other process does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("run")))
        yield
