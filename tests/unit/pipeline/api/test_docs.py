"""The Python examples of the documents run as printed, on a simulated picture."""

from __future__ import annotations

import os
import re
import subprocess
import sys
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
    """A folder with a recording's picture, of panel 7 at 1 m, and camera.yaml."""
    monkeypatch.chdir(tmp_path)
    Path("take/frames").mkdir(parents=True)
    cv2.imwrite("take/frames/000000.png", pictures(1, distance_m=1.0)[0][0])
    Path("markers.yaml").write_text("panels: {7: {position_m: [0, 0, 1], yaw_deg: 180}}\n", encoding="utf-8")
    for lens in ("camera.yaml", "take/camera.yaml"):
        Path(lens).write_text(camera_yaml_text(INTRINSICS, {}), encoding="utf-8")


@pytest.mark.usefixtures("desk")
def test_the_page_s_examples_run_from_top_to_bottom(capsys: pytest.CaptureFixture[str]) -> None:
    """In one program; `pictures` is a stream of the panel."""
    program = {"pictures": pictures(3, distance_m=1.0), "wheels": lambda: (0.0, 0.0)}
    for block in examples("docs/python.md"):
        exec(block, program)
    printed = capsys.readouterr().out.splitlines()
    assert "this is ID 7, which panels.ids does not list" in " ".join(printed)
    numbers = [line for line in printed if line.startswith("7 ")]
    assert len(numbers) == 5
    assert numbers[3].endswith("3")  # frames_used
    assert printed[-1].startswith("image: must be grey, (height, width) uint8, not (480, 640, 3) uint8: ")


@pytest.mark.slow
def test_the_readme_s_lines_pass_a_strict_type_checker(tmp_path: Path) -> None:
    """As printed, by OpenCV's own stubs."""
    (tmp_path / "program.py").write_text(examples("README.md")[0], encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file=", "program.py"]
    environment = os.environ | {"MYPYPATH": str(ROOT)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    # "no issues found in 1 source file", or "(checked 1 source file)" where OpenCV's own stubs have faults.
    assert "1 source file" in done.stdout
    # Installed packages are not judged; here ledpi lies in a folder, and its own configuration judges it.
    assert [line for line in done.stdout.splitlines() if line.startswith("program.py")] == []


def test_the_readme_and_the_page_begin_alike() -> None:
    """Whoever has tried the first goes on with the second."""
    assert examples("README.md")[0] == examples("docs/python.md")[0]
