"""Makes the pictures of docs/pictures anew; `scripts/pictures` runs it. A test compares the commands with the pages."""

from __future__ import annotations

import argparse
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs" / "pictures"
SHOW = "ledpi snapshot --config config.yaml --set camera.source=simulated --frame 240"

# Picture → the page that prints how it is made, and those commands.
BY_COMMANDS = {
    "snapshot.jpg": ("docs/commands.md", [f"{SHOW} --out docs/pictures/snapshot.jpg"]),
    "steps-likelihood.jpg": ("docs/architecture.md", [f"{SHOW} --steps --out docs/pictures/steps-likelihood.jpg"]),
    "steps-uemura.jpg": (
        "docs/architecture.md",
        [f"{SHOW} --set camera.exposure_us=150 --method uemura --steps --out docs/pictures/steps-uemura.jpg"],
    ),
    "decoys.jpg": (
        "docs/evaluating.md",
        [
            "python -m evaluation.suites --out look --suite decoys --case near_words --exposure-us 10000 --take 20",
            "ledpi snapshot look --out docs/pictures/decoys.jpg",
        ],
    ),
    "drive.png": ("docs/state.md", ["python -m scripts.demo_drive --out docs/pictures/drive.png"]),
    "docking.png": ("docs/state.md", ["python -m evaluation.drives.picture --out docs/pictures/docking.png"]),
    "coverage.png": (
        "docs/calibration.md",
        [
            "ledpi simulate take --scene board --frames 100 --set camera.frame_duration_us=100000",
            "ledpi calibrate camera take",
        ],
    ),
}
# Module with a function `draw` that draws all of these into a folder.
DRAWN = {
    "scripts.pictures_first_panel": (
        "driver-waves.png",
        "first-hour-sheet.png",
        "first-panel-sheet.png",
        "first-panel-circuit.png",
        "first-panel.jpg",
    ),
    "scripts.pictures_live_page": ("view-desktop.png", "view-phone.png", "view-why-not.png"),
    "scripts.pictures_frequencies": (
        "frequencies-bands.png",
        "frequencies-contrast.png",
        "frequencies-second.png",
        "frequencies-period.png",
    ),
}
NAMES = [*BY_COMMANDS, *(name for names in DRAWN.values() for name in names)]


def make(names: list[str], into: Path) -> None:
    """Makes these pictures, and those that are drawn with them, in a folder.

    Raises subprocess.CalledProcessError where a command fails.
    """
    for name in names:
        if name in BY_COMMANDS:
            run_commands(name, into)
    for module, drawn in DRAWN.items():
        if set(drawn) & set(names):
            import_module(module).draw(into)


def run_commands(name: str, into: Path) -> None:
    """In a folder where they find what they name, and leave nothing behind."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        shutil.copy(ROOT / "config.yaml", work)
        (work / "docs").mkdir()
        (work / "docs/pictures").symlink_to(into.resolve())
        for command in BY_COMMANDS[name][1]:
            print(command, flush=True)
            words = shlex.split(command.removeprefix("python -m "))
            environment = os.environ | {"PYTHONPATH": str(ROOT)}  # where evaluation/ is
            subprocess.run([sys.executable, "-m", *words], cwd=work, env=environment, check=True)
        if (work / name).exists():  # the command chose the place
            shutil.copy(work / name, into)


def main() -> None:
    parser = argparse.ArgumentParser(prog="scripts/pictures", description=f"Pictures: {', '.join(NAMES)}.")
    parser.add_argument("names", nargs="*", metavar="PICTURE", help="these only; default: all")
    names = parser.parse_args().names
    unknown = [name for name in names if name not in NAMES]
    if unknown:
        parser.error(f"no picture {unknown[0]}; there are: {', '.join(NAMES)}")
    make(names or NAMES, PICTURES)


if __name__ == "__main__":
    main()
