"""docs/first-packet.md: what a reader copies from it does what it says."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from ledpi.camera.simulated import open_simulated
from ledpi.config.settings import load_config
from ledpi.core.records import Frame
from ledpi.pipeline.pipeline import Pipeline, load_robot
from tests.builders.receiver import HEADER, ROOT

PAGE = (ROOT / "docs" / "first-packet.md").read_text(encoding="utf-8")
ARDUINO = """
#include <stdint.h>
struct Stream { void begin(long) {} int available() { return 0; } int read() { return 0; } } Serial1;
uint32_t millis() { return 0; }
"""
YOURS = """
static void steer_by(const ledpi_fix *) {}
static void stop_motors() {}
"""


def block(language: str) -> str:
    """The page's one block of that language."""
    (content,) = re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    return str(content)


@pytest.mark.skipif(shutil.which("g++") is None, reason="not installed: g++")
def test_the_sketch_compiles(tmp_path: Path) -> None:
    """With what an Arduino has, and the reader's own two functions, without a warning."""
    include, _, rest = block("c").partition("\n")
    sketch = tmp_path / "sketch.cpp"
    sketch.write_text(f"{ARDUINO}{include}{YOURS}{rest}\nint main() {{ setup(); loop(); }}\n", encoding="utf-8")
    command = ["g++", "-std=c++11", "-Wall", "-Wextra", "-Werror", "-I", str(HEADER.parent), str(sketch)]
    subprocess.run([*command, "-o", str(tmp_path / "sketch")], check=True)


def test_the_simulated_robot_has_a_fix_by_the_page_s_map(tmp_path: Path) -> None:
    """With the page's own settings, and its markers.yaml."""
    (tmp_path / "markers.yaml").write_text(block("yaml"), encoding="utf-8")
    (command,) = re.findall(r"ledpi run (.*camera.source=simulated.*)", PAGE)
    given = dict(re.findall(r"--set (\S+?)=(\S+)", command)) | {"map": str(tmp_path / "markers.yaml")}
    config = load_config(None, tuple(f"{key}={value}" for key, value in given.items()))
    camera = open_simulated(config, paced=False)
    pipeline = Pipeline(camera.info, config.panels, intrinsics=camera.info.intrinsics, robot=load_robot(config))
    into = np.zeros((camera.info.height, camera.info.width), np.uint8)
    for _ in range(15):
        frame = camera.read(into.copy())
        assert isinstance(frame, Frame)
        if pipeline.decode(frame).robot is not None:
            return
    pytest.fail("no fix in a quarter of a second")
