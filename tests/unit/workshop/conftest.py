"""The command line, as each test of the workshop runs it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.builders.command import Run, in_process


@pytest.fixture
def ledpi(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs `ledpi …` in an empty folder → exit status, standard output, standard error."""
    monkeypatch.chdir(tmp_path)
    return in_process(monkeypatch, capsys)
