"""The recording of which bags and logs are made."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.builders.daemon import write_recording

FRAMES = 12
OFFSET_NS = 1790000000123456789


@pytest.fixture(scope="module")
def take(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Panel 7, a metre away; taken on a day of 2026."""
    folder = tmp_path_factory.mktemp("bags") / "take"
    write_recording(folder, FRAMES)
    with (folder / "recording.yaml").open("a", encoding="utf-8") as file:
        file.write(f"wall_clock_offset_ns: {OFFSET_NS}\n")
    (folder / "controller.jsonl").write_text('{"asked_ns": 1, "number": 1}\n', encoding="utf-8")
    return folder
