"""A disk without room: one line says which file, how much is free and what would help; status 1, as it may pass."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.builders.daemon import SIMULATED, write_recording
from tests.builders.small_disk import needs_small_disk, on_a_small_disk

pytestmark = needs_small_disk
SAID = r"the disk is full \(\d+\.\d MB free\); make room on it, or write to another one"
LIVE = [part for item in SIMULATED for part in ("--set", item)]


@pytest.fixture(scope="module")
def take(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Some 2 MB."""
    folder = tmp_path_factory.mktemp("full") / "take"
    write_recording(folder, 12)
    return folder


def refused(folder: Path, *arguments: object, has_kb: int = 400, full_kb: int = 0) -> str:
    """The last line on standard error."""
    done = on_a_small_disk(folder, *arguments, has_kb=has_kb, full_kb=full_kb)
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr.splitlines()[-1]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a.mcap", "a.wpilog"])
def test_an_export_finds_no_room(take: Path, tmp_path: Path, name: str) -> None:
    """Nothing is left of it, so that it may be tried again."""
    pytest.importorskip("mcap")
    out, options = tmp_path / "disk" / name, ["--wpilog"] if name == "a.wpilog" else []
    full_kb = 398 if options else 0  # poses alone take little
    assert re.fullmatch(
        f"ledpi: {out}: cannot be written: {SAID}",
        refused(tmp_path / "disk", "export", take, out, *options, full_kb=full_kb),
    )


@pytest.mark.slow
def test_an_import_finds_no_room(take: Path, tmp_path: Path) -> None:
    """A bag of ours, whose pictures become files of their own."""
    pytest.importorskip("mcap")
    bag, out = tmp_path / "a.mcap", tmp_path / "disk/out"
    (tmp_path / "enough").mkdir()
    assert on_a_small_disk(tmp_path / "enough", "export", take, bag, has_kb=4).returncode == 0
    said = refused(tmp_path / "disk", "import", bag, out)
    assert re.fullmatch(rf"ledpi: {out}/frames/\d+\.png: cannot be written: {SAID}", said)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["take", "a.mcap"])
def test_a_recording_finds_no_room(tmp_path: Path, name: str) -> None:
    """Frames until then stay, and are told."""
    pytest.importorskip("mcap")
    out = tmp_path / "disk" / name
    done = on_a_small_disk(tmp_path / "disk", "record", out, "--frames", 60, *LIVE, has_kb=300)
    assert done.returncode == 1
    assert re.search(rf"^ledpi: {out}\S*: cannot be written: {SAID}$", done.stderr, re.MULTILINE), done.stderr
    assert re.search(rf"^{out}: \d+ frames?, ", done.stdout)


@pytest.mark.slow
def test_a_backup_finds_no_room(tmp_path: Path) -> None:
    """And a calibration, which is written in the same way."""
    config, out = tmp_path / "config.yaml", tmp_path / "disk/robot.ledpi"
    config.write_text("panels: {side_m: 0.16}\n", encoding="utf-8")
    said = refused(tmp_path / "disk", "backup", out, "--config", config, full_kb=400)
    assert re.fullmatch(f"ledpi: {out}: cannot be written: {SAID}", said)
