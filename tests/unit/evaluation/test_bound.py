"""`evaluation/accuracy/bound.py SET`: today's figures beside the frozen ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from evaluation.accuracy import bound as bench
from evaluation.suites.conditions import Condition
from evaluation.suites.keep import write_take
from ledpi.config.panels import PanelSettings

NEAR = Condition(suite="beyond", distance_m=0.8, angle_deg=0.0)


@pytest.fixture
def recordings(tmp_path: Path) -> Path:
    """Two plain takes of twelve frames, by the names of frozen ones."""
    for number in range(2):
        write_take(tmp_path / f"take{number}", NEAR, PanelSettings(side_m=0.16), 1, number, None)
    return tmp_path


@pytest.mark.slow
def test_todays_figures_stand_beside_the_frozen_ones(
    recordings: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """For each recording, and for those together whose names differ in a number; none where one was not frozen."""
    frozen = tmp_path / "frozen.yaml"
    frozen.write_text("commit: abc1234\nfigures: {skip 9: {take0: [2, 1, 3], take1: [3, 0, 3]}}\n", encoding="utf-8")
    monkeypatch.setattr(bench, "FROZEN", frozen)
    bench.of_recordings(recordings, single=False, skip=9)
    lines = [line.split("  ") for line in capsys.readouterr().out.splitlines()]
    said = [[word.strip() for word in line if word.strip()] for line in lines]
    assert said == [
        ["true corners given", "at abc1234"],
        ["take0", "3 of 3 (100%)", "2 of 3 (67%), 1 WRONG"],
        ["take1", "3 of 3 (100%)", "3 of 3 (100%)"],
        ["take*", "6 of 6 (100%)", "5 of 6 (83%), 1 WRONG"],
    ]
    bench.of_recordings(recordings, single=False, skip=8)
    assert "–" in capsys.readouterr().out.splitlines()[-1]


def test_what_was_frozen_adds_up() -> None:
    """No more is read than is shown, in the file that the benchmark has."""
    import yaml

    figures = yaml.safe_load(bench.FROZEN.read_text(encoding="utf-8"))["figures"]
    assert set(figures) == {"single", "skip 3"}
    for read, wrong, shown in (counts for mode in figures.values() for counts in mode.values()):
        assert 0 <= read + wrong <= shown
