"""`python -m evaluation.speed` and its like: what there is, and that one command runs it."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

from evaluation.running import Part, run
from tests.builders import ROOT

FOLDERS = ("accuracy", "speed", "endurance")


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_benchmark_is_listed(folder: str) -> None:
    """Each module that can be run; but for what `attack` runs."""
    parts = importlib.import_module(f"evaluation.{folder}.__main__").PARTS
    modules = [path for path in (ROOT / "evaluation" / folder).glob("*.py") if path.stem != "__main__"]
    runnable = {path.stem for path in modules if "\ndef main(" in path.read_text(encoding="utf-8")}
    assert {part.name for part in parts} == runnable - {"hostile"}


@pytest.mark.parametrize("folder", FOLDERS)
def test_the_help_says_what_each_measures(folder: str) -> None:
    """As it is called."""
    command = [sys.executable, "-m", f"evaluation.{folder}", "--help"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    parts = importlib.import_module(f"evaluation.{folder}.__main__").PARTS
    assert done.stdout.startswith(f"usage: python -m evaluation.{folder} ")
    for part in parts:
        (line,) = [line for line in done.stdout.splitlines() if line.split()[:1] == [part.name]]
        assert len(line.split()) > 4


@pytest.mark.parametrize("folder", FOLDERS)
def test_each_has_help_of_its_own(
    folder: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Wherever what it needs is there."""
    for part in importlib.import_module(f"evaluation.{folder}.__main__").PARTS:
        if part.module is None or part.missing is None:
            monkeypatch.setattr(sys, "argv", [part.name, "--help"])
            with pytest.raises(SystemExit) as ended:
                importlib.import_module(f"evaluation.{folder}.{part.name}").main()
            assert (ended.value.code, capsys.readouterr().out[:6]) == (0, "usage:"), part.name


def test_another_name_is_refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """In one line, with the names that there are, and status 2."""
    monkeypatch.setattr(sys, "argv", ["", "latencies"])
    assert run("evaluation.speed", (Part("panels"), Part("latency"))) == 2
    assert capsys.readouterr().err == "evaluation.speed: no benchmark latencies; there are: panels, latency\n"


@pytest.mark.slow
def test_of_all_one_may_fail_or_lack_something(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The others are run all the same; it is said at the end, and the status is 1."""
    monkeypatch.setattr(sys, "argv", [""])
    monkeypatch.chdir(ROOT)
    parts = (Part("panels", ("--panels", "0")), Part("capture", module="no_such_module"), Part("latency", ("--help",)))
    assert run("evaluation.speed", parts) == 1
    out, errors = capfd.readouterr()
    assert "left out: no no_such_module in this environment" in out
    assert "--allow-ms" in out
    assert errors.splitlines()[-1] == "evaluation.speed: failed: panels"
