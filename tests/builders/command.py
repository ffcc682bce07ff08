"""The command line within the tests' own process, which is quicker than one of its own."""

from __future__ import annotations

import sys
from collections.abc import Callable

import pytest

from ledpi.cli import main

Run = Callable[..., tuple[int, str, str]]


def in_process(monkeypatch: pytest.MonkeyPatch, captured: pytest.CaptureFixture[str], *command: str) -> Run:
    """Runs `ledpi COMMAND …` → exit status, standard output, standard error."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["ledpi", *command, *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
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
