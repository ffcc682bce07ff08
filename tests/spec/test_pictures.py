"""The pictures of the pages: one script makes them all, by the commands that the pages print."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import cv2
import pytest

from scripts.pictures import BY_COMMANDS, NAMES, PICTURES, make
from tests.builders import ROOT


def test_the_script_makes_what_there_is() -> None:
    """No picture that nobody can make again, and none that is missing."""
    assert sorted(NAMES) == sorted(path.name for path in PICTURES.iterdir())


def test_every_picture_is_shown() -> None:
    """On some page."""
    text = "".join(page.read_text(encoding="utf-8") for page in [ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
    assert [name for name in NAMES if f"pictures/{name})" not in text] == []


def test_scripts_say_what_their_environment_is_for() -> None:
    """As scripts/venv.sh wants it: a folder, and which of the extras. Otherwise it ends at once in a fresh clone."""
    scripts = [path for path in (ROOT / "scripts").iterdir() if path.is_file() and path.suffix == ""]
    calls = {
        path.name: re.findall(r"^make_venv (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE) for path in scripts
    }
    assert {name for name, found in calls.items() if found} >= {"demo", "pictures", "test"}
    assert [name for name, found in calls.items() if any(len(shlex.split(call)) < 2 for call in found)] == []


@pytest.mark.parametrize("name", BY_COMMANDS)
def test_a_page_prints_the_commands_that_make_its_picture(name: str) -> None:
    """Word for word, in this order; a line may be continued."""
    page, commands = BY_COMMANDS[name]
    text = re.sub(r" *\\\n +", " ", (ROOT / page).read_text(encoding="utf-8"))
    assert "\n".join(f"    {command}" for command in commands) + "\n" in text


@pytest.mark.slow
def test_a_picture_can_be_made_again(tmp_path: Path) -> None:
    """As large as the one on the page; nothing else is left behind."""
    make(["steps-likelihood.jpg"], tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["steps-likelihood.jpg"]
    made, kept = (cv2.imread(str(folder / "steps-likelihood.jpg")) for folder in (tmp_path, PICTURES))
    assert made is not None
    assert kept is not None
    assert made.shape == kept.shape
