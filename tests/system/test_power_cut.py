"""The power is cut at any moment: no file of the user's is lost, or half there. By real system calls, under strace."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.builders.power_cut import Disk, each_call, writer


def strace_works() -> bool:
    command = ["strace", "-o", os.devnull, "-e", "inject=getppid:signal=CONT", "true"]
    return shutil.which("strace") is not None and subprocess.run(command, check=False).returncode == 0


pytestmark = pytest.mark.skipif(not strace_works(), reason="needs strace, and leave to trace")

OLD = "camera: {row_time_us: 33.67}  # as measured in May\n"
NEW = "camera: {row_time_us: 31.75}  # as measured in May\n"
CHANGES = {
    "config.yaml": (
        "from pathlib import Path; from ledpi.workshop.calibrate.files import change_config, changed_yaml; "
        "changed_yaml('a: {b: 0}', {('a', 'b'): 1})",  # what it imports opens files of its own
        'change_config(Path("config.yaml").absolute(), {("camera", "row_time_us"): 31.75})',
    ),
    "camera.yaml": (
        "from pathlib import Path; from ledpi.workshop.calibrate.files import write_keeping_old",
        f'write_keeping_old(Path("camera.yaml").absolute(), {NEW!r})',
    ),
}
TAKE = (
    "from pathlib import Path; from ledpi.camera.recording.writer import RecordingWriter; "
    "from ledpi.core.records import CameraInfo, PanelSpec; "
    "camera = CameraInfo(width=64, height=48, exposure_us=1e4, row_time_us=33.67, transfer='linear'); "
    "panel = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)",
    "RecordingWriter(Path('take').absolute(), camera=camera, dictionary='DICT_4X4_50', panel=panel).__enter__()",
)


@pytest.fixture
def place(tmp_path: Path) -> Path:
    folder = tmp_path / "place"
    folder.mkdir()
    return folder


@pytest.mark.parametrize("name", CHANGES)
def test_between_any_two_system_calls_the_file_is_whole(name: str, place: Path, tmp_path: Path) -> None:
    """Stopped before any of them, the older file or the new one has the name; in the end the older one is kept."""
    file = place / name
    file.write_text(OLD)
    with writer(*CHANGES[name], place, tmp_path / "trace") as process:
        calls = list(each_call(process.trace()))
        assert (file.read_text(), (place / f"{name}.bak-1").read_text()) == (NEW, OLD)
        assert sorted(os.listdir(place)) == [name, f"{name}.bak-1"]
        for call, number in calls:
            for left in place.iterdir():
                left.unlink()
            file.write_text(OLD)
            process.stop_at(call, number)
            assert file.read_text() in (OLD, NEW), (call, number)
    assert {"write", "fsync", "rename"} <= {call for call, _ in calls}


@pytest.mark.slow
@pytest.mark.parametrize("name", CHANGES)
def test_what_the_disk_has_not_been_told_to_keep_is_not_needed(name: str, place: Path, tmp_path: Path) -> None:
    """After each call all bytes and names may be gone that were not synchronised: a whole file has the name still."""
    (place / name).write_text(OLD)
    disk = Disk(place)
    with writer(*CHANGES[name], place, tmp_path / "trace") as process:
        for line in process.trace():
            disk.apply(line)
            assert all(found.get(name) for found in disk.after_cut()), line
    assert disk.after_cut() == [{name: True, f"{name}.bak-1": True}]


@pytest.mark.slow
def test_a_take_has_a_whole_header_or_none(place: Path, tmp_path: Path) -> None:
    """So that a recording that is there can be read; its pictures are another matter."""
    with writer(*TAKE, place, tmp_path / "trace") as process:
        (place / "take").mkdir()
        disk = Disk(place / "take")
        (place / "take").rmdir()
        for line in process.trace():
            disk.apply(line)
            assert all(found.get("recording.yaml", True) for found in disk.after_cut()), line
    assert all(found["recording.yaml"] for found in disk.after_cut())


def test_where_a_file_has_one_name_only_a_copy_is_kept(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on FAT, or where it is another user's."""
    from ledpi.workshop.calibrate.files import write_keeping_old

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", refuse)
    for text in ("one", "two", "three"):
        write_keeping_old(place / "camera.yaml", text)
    kept = {path.name: path.read_text() for path in place.iterdir()}
    assert kept == {"camera.yaml": "three", "camera.yaml.bak-1": "one", "camera.yaml.bak-2": "two"}
