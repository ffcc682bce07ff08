"""Recordings listed, read and deleted by name: what is given out, and what no name can reach."""

from __future__ import annotations

import io
import tarfile
from pathlib import Path
from typing import Any

import pytest

from ledpi.core.errors import RecordingError
from ledpi.core.records import PanelSpec
from ledpi.daemon import kept_takes
from ledpi.daemon.kept_takes import KeptTakes
from ledpi.daemon.takes import MAX_AUTOMATIC, Shown, make_room, new_take, note_begun
from ledpi.daemon.tap.protocol import Request
from tests.builders.tap import CAMERA

NAME = "20261124T101502Z-asked"
OTHER = "20261124T101503Z-camera_lost-2"
SHOWN = Shown(CAMERA, "DICT_4X4_50", PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0), "simulated")
HOSTILE = [
    *("", ".", "..", "/", "../secret", f"../{NAME}", f"{NAME}/../../secret", f"{NAME}/frames", f"./{NAME}"),
    *(f"{NAME}\0", f"{NAME}\n", f" {NAME}", "secret", "linked", "/etc/passwd", "%2e%2e%2fsecret", "..\\secret"),
    *("20261124T101502Z-", "20261124T101502Z-asked.part.part", "２０２６1124T101502Z-asked", "*", "~", "-rf"),
]


def request(name: str | None = None, offset: int = 0) -> Request:
    return Request(do="take", name=name, offset=offset)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two takes, and beside them what is none of them."""
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret/key").write_bytes(b"secret")
    takes = tmp_path / "takes"
    for name in (NAME, OTHER):
        (takes / name / "frames").mkdir(parents=True)
        (takes / name / "recording.yaml").write_bytes(b"format: 1\n")
        for number, size in enumerate((0, 1, 511, 512, 513, 100_000)):
            (takes / name / "frames" / f"{number:06d}.png").write_bytes(bytes((number + 1,)) * size)
    (takes / "secret").mkdir()
    return takes


def whole(kept: KeptTakes, name: str) -> bytes:
    """All pieces in a row."""
    data, size = b"", 1
    while len(data) < size:
        piece: dict[str, Any] = kept.read(request(name, len(data)))
        assert 0 < len(piece["raw"]) <= kept_takes.PIECE_BYTES
        data, size = data + piece["raw"], piece["size"]
    return data


def test_the_newest_is_listed_first(folder: Path) -> None:
    """With how many frames it has; what has another kind of name is none."""
    assert KeptTakes(folder).list(request())["takes"] == [
        {"name": OTHER, "frames": 6, "written": False},
        {"name": NAME, "frames": 6, "written": False},
    ]
    assert KeptTakes(folder / "nowhere").list(request()) == {"takes": []}


def test_a_clock_that_went_back_makes_nothing_older(tmp_path: Path) -> None:
    """The one begun last stays, and is listed first, whatever time is in its name."""
    old = [f"2026112{day}T000000Z-camera_lost" for day in range(5)]
    new = ["20261101T000000Z-camera_lost", "20260101T000000Z-contradicted"]
    for name in (*old, *new):
        if name in new:
            note_begun(tmp_path, name)
        (tmp_path / name).mkdir()
    make_room(tmp_path, "camera_lost", 0)
    listed = [take["name"] for take in KeptTakes(tmp_path).list(request())["takes"]]
    assert listed == [*reversed(new), *reversed(old)][: MAX_AUTOMATIC - 1]


@pytest.mark.parametrize("piece_bytes", [1, 700, 1 << 18])
def test_a_take_is_read_as_a_tar_file(folder: Path, monkeypatch: pytest.MonkeyPatch, piece_bytes: int) -> None:
    """Python's own reader unpacks what it was, whatever the pieces; links in it are left out."""
    take = folder / NAME
    (take / "frames/linked.png").symlink_to(folder.parent / "secret/key")
    (take / "more").symlink_to(folder.parent / "secret")
    if piece_bytes == 1:
        (take / "frames/000005.png").unlink()
    monkeypatch.setattr(kept_takes, "PIECE_BYTES", piece_bytes)
    with tarfile.open(fileobj=io.BytesIO(whole(KeptTakes(folder), NAME))) as archive:
        found = {}
        for member in archive.getmembers():
            assert member.isreg()
            file = archive.extractfile(member)
            assert file is not None
            found[member.name] = file.read()
    frames = sorted(path for path in (take / "frames").iterdir() if not path.is_symlink())
    assert found == {
        f"{NAME}/{path.relative_to(take)}": path.read_bytes() for path in (*frames, take / "recording.yaml")
    }


@pytest.mark.parametrize("name", HOSTILE)
def test_no_name_leads_outside_of_the_folder(folder: Path, name: str) -> None:
    """Neither for reading nor for deleting; all that is there stays."""
    (folder / "linked").symlink_to(folder.parent / "secret")
    before = sorted(folder.parent.rglob("*"))
    for do in (KeptTakes(folder).read, KeptTakes(folder).delete):
        with pytest.raises(RecordingError, match=r"^name: must be that of a take; `takes` lists them$"):
            do(request(name))
    assert sorted(folder.parent.rglob("*")) == before


def test_a_link_with_a_takes_name_is_no_take(folder: Path) -> None:
    """It is not listed, not read, and what it leads to is not deleted."""
    linked = "20261124T101504Z-asked"
    (folder / linked).symlink_to(folder.parent / "secret")
    kept = KeptTakes(folder)
    assert linked not in [take["name"] for take in kept.list(request())["takes"]]
    for do in (kept.read, kept.delete):
        with pytest.raises(RecordingError, match="is no folder, and no take"):
            do(request(linked))
    assert (folder.parent / "secret/key").exists()


def test_a_take_is_deleted_for_good(folder: Path) -> None:
    """The other one stays; a second time there is none."""
    kept = KeptTakes(folder)
    kept.delete(request(NAME))
    assert [take["name"] for take in kept.list(request())["takes"]] == [OTHER]
    with pytest.raises(RecordingError, match="there is no such take"):
        kept.delete(request(NAME))
    with pytest.raises(RecordingError, match="there is no such take"):
        kept.read(request(NAME))


def test_a_take_that_is_being_written_is_neither_read_nor_deleted(folder: Path) -> None:
    """Until the end; what was broken off is a take like others."""
    kept = KeptTakes(folder)
    writing = new_take(folder, SHOWN, "recorded", "")
    take = writing.__enter__()
    take.written = 1  # so that it stays
    part = f"{take.path.name}.part"
    assert kept.list(request())["takes"][0] == {"name": part, "frames": 0, "written": True}
    for do in (kept.read, kept.delete):
        with pytest.raises(RecordingError, match="is being written"):
            do(request(part))
    assert not writing.__exit__(RuntimeError, RuntimeError(), None)
    assert kept.list(request())["takes"][0] == {"name": part, "frames": 0, "written": False}
    kept.delete(request(part))
    assert not (folder / part).exists()


def test_what_is_beyond_the_end_is_refused(folder: Path) -> None:
    """The end itself is an empty piece."""
    kept = KeptTakes(folder)
    size = kept.read(request(NAME))["size"]
    assert kept.read(request(NAME, size))["raw"] == b""
    with pytest.raises(RecordingError, match=rf"^offset: the take has {size} bytes, not {size + 1}$"):
        kept.read(request(NAME, size + 1))
