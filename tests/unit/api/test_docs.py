"""The Python examples of the documents run as printed, on a simulated picture."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import pytest

from ledpi.config.camera_yaml import camera_yaml_text
from tests.builders import ROOT
from tests.builders.api import INTRINSICS, pictures


def examples(document: str) -> list[str]:
    """The page's Python blocks."""
    text = (ROOT / document).read_text(encoding="utf-8")
    return re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with frame.png, of panel 7 at 1 m, and camera.yaml."""
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("frame.png", pictures(1, distance_m=1.0)[0][0])
    Path("camera.yaml").write_text(camera_yaml_text(INTRINSICS, {}), encoding="utf-8")


@pytest.mark.usefixtures("desk")
def test_the_readme_s_lines_read_a_picture(capsys: pytest.CaptureFixture[str]) -> None:
    """Panel 7, its position, yaw and distance."""
    (lines,) = examples("README.md")
    exec(lines, {})
    printed = capsys.readouterr().out.split()
    assert printed[0] == "7"
    assert float(printed[-1]) == pytest.approx(1.0, abs=0.005)


@pytest.mark.usefixtures("desk")
def test_the_page_s_examples_run_from_top_to_bottom(capsys: pytest.CaptureFixture[str]) -> None:
    """In one program; `pictures` is a stream of the panel."""
    program = {"pictures": pictures(3, distance_m=1.0)}
    for block in examples("docs/python.md"):
        exec(block, program)
    printed = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in printed] == ["7", "7", "7", "7", "7", "image:"]
    assert printed[3].endswith("3")  # frames_used
    assert printed[-1].startswith("image: must be grey, (height, width) uint8, not (480, 640, 3) uint8: ")


def test_the_readme_and_the_page_begin_alike() -> None:
    """Whoever has tried the first goes on with the second."""
    assert examples("README.md")[0] == examples("docs/python.md")[0]
