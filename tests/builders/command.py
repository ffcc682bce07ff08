"""The command line: within the tests' own process, which is quicker, or in one of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from ledpi.cli import main
from tests.builders import ROOT
from tests.builders.waiting import limit_s

LEDPI = [sys.executable, "-c", "from ledpi.cli import main; main()"]

Run = Callable[..., tuple[int, str, str]]


def in_process(monkeypatch: pytest.MonkeyPatch, captured: pytest.CaptureFixture[str], *command: str) -> Run:
    """Runs `ledpi COMMAND …` → exit status, standard output, standard error. Signals mean afterwards what they did."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["ledpi", *command, *map(str, arguments)])
        handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGHUP, signal.SIGUSR1)}
        with pytest.raises(SystemExit) as ended:
            main()
        for number, handler in handlers.items():
            signal.signal(number, handler)
        output, errors = captured.readouterr()
        return int(ended.value.code or 0), output, errors

    return run


def ledpi(
    *arguments: object, cwd: Path = ROOT, capture_output: bool = True, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Runs it in a process of its own, where what only a whole process has is tested."""
    command, options = [*LEDPI, *map(str, arguments)], {"env": os.environ | {"PYTHONPATH": str(ROOT)}} | options
    return subprocess.run(command, cwd=cwd, capture_output=capture_output, text=True, timeout=limit_s(30), **options)


def output_of(app: typer.Typer, *arguments: str) -> str:
    """Standard output of a command in this process; a LedpiError comes through, as `main` prints it."""
    result = CliRunner().invoke(app, arguments)
    if result.exception is not None:
        raise result.exception
    return result.stdout


def complaint(run: tuple[int, str, str]) -> str:
    """The one line on standard error of a run that printed nothing else and ended with status 2."""
    status, output, errors = run
    assert (status, output) == (2, "")
    (line,) = errors.splitlines()
    assert line.startswith("ledpi: ")
    return line
