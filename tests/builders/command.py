"""The command line within the tests' own process, which is quicker than one of its own."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable

import pytest

from ledpi.cli import main

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


def complaint(run: tuple[int, str, str]) -> str:
    """The one line on standard error of a run that printed nothing else and ended with status 2."""
    status, output, errors = run
    assert (status, output) == (2, "")
    (line,) = errors.splitlines()
    assert line.startswith("ledpi: ")
    return line
