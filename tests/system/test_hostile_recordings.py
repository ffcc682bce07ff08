"""`ledpi decode` of what was made to fill the memory or to hang: decoded, or refused in one line, in bounds."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from tests.builders.daemon import slowness, write_recording

MAX_BYTES, MAX_S = 500e6, 10.0
# At its end it tells the most memory that it held. (What wait4 tells begins with that of the tests' own process.)
DECODE = """
import atexit, os
atexit.register(lambda: open(os.environ["STATUS"], "w").write(open("/proc/self/status").read()))
from ledpi.cli import main
main()
"""
SIDE = 16384  # of a picture that takes 268 MB, and its half-sized copies as much again


def decoded(*arguments: object) -> tuple[int, str, list[str]]:
    """Exit status, standard output, and the lines on standard error; within the bounds of memory and time."""
    with tempfile.NamedTemporaryFile(mode="r") as status:
        done = subprocess.run(
            [sys.executable, "-c", DECODE, "decode", *map(str, arguments)],
            env=os.environ | {"STATUS": status.name},
            capture_output=True,
            text=True,
            check=False,
            timeout=MAX_S * slowness(),
        )
        (peak_kb,) = re.findall(r"VmHWM:\s*(\d+) kB", status.read())
    assert int(peak_kb) * 1024 < MAX_BYTES
    lines = done.stderr.splitlines()
    assert all(line.startswith("ledpi: ") and len(line) < 1000 for line in lines), done.stderr[-2000:]
    return done.returncode, done.stdout, lines


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of three frames."""
    take = tmp_path_factory.mktemp("sound") / "take"
    write_recording(take, 3)
    return take


@pytest.fixture
def take(sound: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(sound, tmp_path / "take"))


def a_pipe(file: Path) -> None:
    os.mkfifo(file)


def a_device(file: Path) -> None:
    file.symlink_to("/dev/zero")


def too_large(file: Path) -> None:
    file.touch()
    os.truncate(file, 2**40)  # without taking any room


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "make"),
    [("recording.yaml", a_pipe), ("frames.jsonl", too_large), ("truth.jsonl", a_device), ("words.yaml", a_device)],
)
def test_a_file_that_never_ends_is_refused(take: Path, name: str, make: Callable[[Path], None]) -> None:
    """A pipe, a device or a terabyte in the place of any file that describes a recording."""
    if name == "words.yaml":
        header = (take / "recording.yaml").read_text()
        (take / "recording.yaml").write_text(header.replace("DICT_4X4_50", name))
    (take / name).unlink(missing_ok=True)
    make(take / name)
    status, output, (complaint,) = decoded(take)
    assert (status, output) == (2, "")
    assert f"{take / name}: " in complaint


@pytest.mark.slow
def test_a_picture_that_never_ends_is_named_and_the_others_are_decoded(take: Path) -> None:
    """The pictures of a recording are files like others."""
    picture = take / "frames/000001.png"
    picture.unlink()
    too_large(picture)
    status, output, (complaint,) = decoded(take)
    assert (status, len(output.splitlines())) == (2, 3)
    assert f"{picture}: " in complaint


HEADERS: dict[str, tuple[dict[str, object], str]] = {
    "slow": ({"black_hz": 10.0, "white_hz": 10.1, "duty": 0.01, "row_time_us": 1.0}, "panel: 10 Hz is too slow"),
    "large": ({"width": SIDE, "height": SIDE}, "camera.width: must be less than or equal to 5000, not 16384"),
}


@pytest.mark.slow
@pytest.mark.parametrize(("changes", "message"), HEADERS.values(), ids=HEADERS)
def test_a_header_beyond_physics_is_refused(take: Path, changes: dict[str, object], message: str) -> None:
    """Else its values ask for gigabytes, or end in an error of numpy's."""
    header = yaml.safe_load((take / "recording.yaml").read_text())
    for key, value in changes.items():
        header["camera" if key in header["camera"] else "panel"][key] = value
    (take / "recording.yaml").write_text(yaml.safe_dump(header))
    status, output, (complaint,) = decoded(take)
    assert (status, output) == (2, "")
    assert f"{take}/recording.yaml: " in complaint
    assert message in complaint


@pytest.mark.slow
@pytest.mark.parametrize("text", ["\n" * 2**24, "[" + "[]," * 9**6 + "[]]\n"])
def test_lines_without_end_are_refused(take: Path, text: str) -> None:
    """Many, or long, or both: of empty lists in a line each would take ten times its text."""
    (take / "frames.jsonl").write_text(text)
    status, output, (complaint,) = decoded(take)
    assert (status, output) == (2, "")
    assert f"{take}/frames.jsonl: " in complaint


def chunk(name: bytes, content: bytes) -> bytes:
    checked = name + content
    return len(content).to_bytes(4, "big") + checked + zlib.crc32(checked).to_bytes(4, "big")


@cache
def huge_png() -> bytes:
    """288 kB that stand for 268 MB."""
    return bytes(cv2.imencode(".png", np.zeros((SIDE, SIDE), np.uint8))[1].tobytes())


@pytest.mark.slow
@pytest.mark.parametrize("before", [b"", chunk(b"tEXt", b"a\0b")], ids=["first", "after another chunk"])
def test_a_huge_picture_in_a_recording_is_not_decoded(take: Path, before: bytes) -> None:
    """Its header tells its size, which must be the recording's, and stands first."""
    png = huge_png()
    (take / "frames/000001.png").write_bytes(png[:8] + before + png[8:])
    status, output, (complaint,) = decoded(take)
    assert (status, len(output.splitlines())) == (2, 3)
    assert "000001.png: " in complaint


@pytest.mark.slow
def test_a_huge_picture_alone_is_not_decoded(tmp_path: Path) -> None:
    """As of any format that OpenCV reads."""
    picture = tmp_path / "huge.tif"
    cv2.imwrite(str(picture), np.zeros((SIDE, SIDE), np.uint8))
    status, output, (complaint,) = decoded("--set", "panels.side_m=0.16", "--set", "camera.row_time_us=33.67", picture)
    assert (status, len(output.splitlines())) == (2, 1)
    assert f"{picture}: cannot be read as a picture of 8 or 16 bits; must be 640 × 480" in complaint


@pytest.mark.slow
def test_the_largest_picture_is_decoded(take: Path) -> None:
    """Within the same bounds; it shows the panel."""
    header = (take / "recording.yaml").read_text()
    header = header.replace("width: 640", "width: 5000").replace("height: 480", "height: 3750")
    for key, value in (("fx", 5022.0), ("fy", 5022.0), ("cx", 2519.0), ("cy", 1859.0)):
        header = header.replace(f"  {key}: ", f"  {key}: {value} # ")
    (take / "recording.yaml").write_text(header.replace("row_time_us: 33.67", "row_time_us: 4.31"))
    for picture in (take / "frames").iterdir():
        small = cv2.imread(str(picture), cv2.IMREAD_GRAYSCALE)
        cv2.imwrite(str(picture), cv2.resize(small, (5000, 3750)))
    status, output, _ = decoded(take)
    assert (status, len(output.splitlines())) == (0, 3)
