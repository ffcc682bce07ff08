"""Fresh environments, in which nothing is installed but what a test wants."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path


def run(*command: str | Path, path: str | None = None) -> str:
    """Returns what it prints; what it says where it fails."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    environment |= {} if path is None else {"PATH": path}
    done = subprocess.run([*map(str, command)], cwd="/", env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


def environment(folder: Path, python: str | Path = sys.executable) -> Path:
    """A fresh one's programs."""
    run(python, "-m", "venv", folder)
    return folder / "bin"


def installer(programs: Path) -> tuple[str | Path, ...]:
    """The beginning of a command that installs: by uv, which takes a fifth of pip's time, where it is there."""
    uv = shutil.which("uv", path=f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    if uv is None:
        return programs / "pip", "install", "--quiet"
    return uv, "pip", "install", "--quiet", "--python", programs / "python"
