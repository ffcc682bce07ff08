"""What the documents point to is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.main import get_command

from ledpi.camera.recovering import DEADLINE_S
from ledpi.cli import app, main

ROOT = Path(__file__).resolve().parents[1]
_GLOBS = ("README.md", "docs/*.md", "firmware/*/*.md")
DOCUMENTS = [str(path.relative_to(ROOT)) for glob in _GLOBS for path in sorted(ROOT.glob(glob))]


@pytest.mark.parametrize("document", DOCUMENTS)
def test_links_lead_to_files(document: str) -> None:
    """Every relative link and picture, from where the document lies."""
    path = ROOT / document
    targets = [t for t in re.findall(r"\]\(([^)#\s]+)", path.read_text(encoding="utf-8")) if "://" not in t]
    assert [target for target in targets if not (path.parent / target).exists()] == []


def test_every_page_can_be_reached_from_the_readme() -> None:
    """By links, a folder standing for its README.md."""
    reached: set[Path] = set()
    waiting = [ROOT / "README.md"]
    while waiting:
        page = waiting.pop()
        if page.suffix == ".md" and page.is_file() and page not in reached:
            reached.add(page)
            targets = re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8"))
            there = [(page.parent / target).resolve() for target in targets if "://" not in target]
            waiting += [path / "README.md" if path.is_dir() else path for path in there]
    assert [document for document in DOCUMENTS if ROOT / document not in reached] == []


@pytest.mark.parametrize("document", ["docs/architecture.md", "docs/faults.md", "docs/raspberry-pi.md"])
def test_when_a_lost_camera_is_given_up(document: str) -> None:
    """Wherever a page says it, it says what the code does."""
    text = (ROOT / document).read_text(encoding="utf-8")
    said = re.findall(r"[Aa]fter (\d+) s\s(?:without a frame|it ends|ends)", text)
    assert said == [f"{DEADLINE_S:g}"]


def test_the_readme_lists_every_command(monkeypatch: pytest.MonkeyPatch) -> None:
    """The table of commands has a row for each that there is, and no other."""
    monkeypatch.setattr("sys.argv", ["ledpi", "--help"])
    with pytest.raises(SystemExit):
        main()  # loads the commands
    listed = re.findall(r"^\| `ledpi (\w+)", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(set(listed)) == sorted(get_command(app).commands)
