"""`python -m evaluation.drives`: a run that was broken off goes on, and what is not met is said."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from evaluation.drives import __main__ as drives


def test_a_run_that_was_broken_off_goes_on_and_says_what_is_not_met(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of three drives is finished, one half written: two are driven, and one line is not met."""
    path = tmp_path / "drives.csv"
    head = ",".join(drives.COLUMNS)
    done = {"case": "plain", "seed": "0", "rms_mm": "20", "raw_mm": "80", "nees": "4", "below_95": "1"}
    done |= {"wpilib_docs_mm": "50", "wpilib_stated_mm": "60"}
    path.write_text(head + "\n" + ",".join(done.get(name, "") for name in drives.COLUMNS) + "\nplain,1,2", "utf-8")
    asked = []

    def judged(case: str, seed: int) -> dict[str, object]:
        asked.append((case, seed))
        return {**done, "seed": seed, "nees": 3.2}

    monkeypatch.setattr(drives, "judge", judged)
    monkeypatch.setattr(drives, "ProcessPoolExecutor", ThreadPoolExecutor)
    rows = drives.drive_all(path, ["plain"], drives=3, workers=1)
    told, met = drives.summary(rows)
    assert asked == [("plain", 1), ("plain", 2)]
    assert [line for line in told.splitlines() if "NOT MET" in line] == [
        "| NEES, highest tenth of the drives | 3 | ≤ 3.6 | 4 | NOT MET |"
    ]
    assert not met
