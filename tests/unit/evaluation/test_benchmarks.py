"""Benchmarks, as `python -m evaluation.speed.latency` and its like: each tells what it does."""

from __future__ import annotations

import importlib
import sys

import pytest

from tests.builders import ROOT

RUNNABLE = [
    f"evaluation.{path.parent.name}.{path.stem}"
    for folder in ("accuracy", "speed", "endurance")
    for path in sorted((ROOT / "evaluation" / folder).glob("*.py"))
    if "\ndef main(" in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("name", RUNNABLE)
def test_each_has_help(name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Wherever what it needs is there."""
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit) as ended:
        importlib.import_module(name).main()
    assert (ended.value.code, capsys.readouterr().out[:6]) == (0, "usage:")
