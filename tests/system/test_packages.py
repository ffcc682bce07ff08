"""The parts of a release: packages that install without a compiler, on each Python and machine that they name."""

from __future__ import annotations

import fcntl
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluation.speed import counting
from ledpi import __version__
from tests.builders import ROOT
from tests.builders.environments import environment, installer, run
from tests.builders.marked import PROGRAM, check_counted

NEWEST_GLIBC = 35  # Ubuntu 22.04's, of ROS 2 Humble
DEMO_MB = 130

PYTHONS = ("3.10", "3.11", "3.12", "3.13")


slow = pytest.mark.slow  # builds packages and installs them


@pytest.fixture(scope="session")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The packages, made once; twine and abi3audit have nothing against them, or scripts/wheels fails."""
    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent  # of all workers
    folder = shared / "dist"
    with (shared / "dist.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (shared / "dist.whole").exists():
            run(ROOT / "scripts/wheels", folder)
            (shared / "dist.whole").touch()
    return folder


@pytest.fixture(scope="session")
def take(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated recording of panel 7 at 0.6 m."""
    folder = tmp_path_factory.mktemp("recordings") / "take"
    run(sys.executable, "-m", "ledpi", "simulate", folder, "--distance", "0.6", "--id", "7", "--frames", "2")
    return folder


def wheel(dist: Path, machine: str) -> Path:
    (path,) = dist.glob(f"*_{machine}.whl")
    return path


def frames(printed: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in printed.splitlines()]


def check_decoded(printed: str) -> None:
    """Panel 7, where it is, to a percent: at 150 µs rows show little of it, and where a fit ends is rounding's."""
    assert [[marker["id"] for marker in frame["markers"]] for frame in frames(printed)] == [[7], [7]]
    for frame in frames(printed):
        assert frame["markers"][0]["position_m"] == pytest.approx([0.0, 0.0, 0.6], abs=0.006)


def interpreter(version: str) -> Path | None:
    """The first that runs; pyenv has stand-ins that do not."""
    for folder in os.get_exec_path():
        candidate = Path(folder) / f"python{version}"
        if candidate.is_file() and subprocess.run([candidate, "-c", ""], capture_output=True).returncode == 0:
            return candidate
    return None


# ---- What the packages say of themselves


def test_the_versions_that_are_claimed_are_tested() -> None:
    """By .ci/run, which runs on one of them and asks for the others by name; pip asks for the lowest."""
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    ci = (ROOT / ".ci/run").read_text(encoding="utf-8")
    claimed = re.findall(r'"Programming Language :: Python :: (3\.\d+)"', project)
    (named,) = re.findall(r"^for version in (.*); do$", ci, re.MULTILINE)
    assert tuple(claimed) == PYTHONS
    assert sorted([*named.split(), "3.11"]) == sorted(claimed)
    assert f'requires-python = ">={PYTHONS[0]}"' in project
    assert f'"cp{PYTHONS[0].replace(".", "")}"' in (ROOT / "setup.py").read_text(encoding="utf-8")


@slow
@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
def test_a_wheel_says_where_it_runs(machine: str, dist: Path) -> None:
    """From Python 3.10 on, and on a Linux no newer than that of ROS 2 Humble."""
    name = wheel(dist, machine).name
    found = re.fullmatch(rf"ledpi-{re.escape(__version__)}-cp310-abi3-manylinux_2_(\d+)_{machine}\.whl", name)
    assert found is not None, name
    assert int(found[1]) <= NEWEST_GLIBC


@slow
@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
def test_a_wheel_holds_every_file_of_the_package(machine: str, dist: Path) -> None:
    """Sources, types, what is drawn or built from; and one library, of that machine."""
    packed = zipfile.ZipFile(wheel(dist, machine))
    names = {name for name in packed.namelist() if name.startswith("ledpi/") and not name.endswith("/")}
    tree = [path for path in (ROOT / "ledpi").rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    links = ("workshop/panel/sources", "shipped-files/examples", "shipped-files/systemd")
    tree += [path for link in links for path in (ROOT / "ledpi" / link).iterdir() if path.name != "__pycache__"]
    left_out = (".so", ".elf", ".hex", "README.md")
    wanted = {str(path.relative_to(ROOT)) for path in tree if not path.name.endswith(left_out)}
    assert names == wanted | {"ledpi/core/_core.abi3.so"}
    elf_machine = {"x86_64": 62, "aarch64": 183}[machine]  # e_machine
    assert packed.read("ledpi/core/_core.abi3.so")[18:20] == elf_machine.to_bytes(2, "little")


# ---- That they run


@slow
@pytest.mark.parametrize(
    "version", [PYTHONS[0], *(pytest.param(each, marks=pytest.mark.nightly) for each in PYTHONS[1:])]
)
def test_a_wheel_needs_no_compiler(version: str, dist: Path, take: Path, tmp_path: Path) -> None:
    """In a fresh environment, with no other program to be found: it installs, decodes, runs, and can be imported."""
    python = interpreter(version)
    if python is None:
        pytest.skip(f"python{version} is not here")
    programs = environment(tmp_path / "venv", python)
    alone = str(programs)
    # By pip, once. What it would compile Python compiles as it imports it, a gigabyte less.
    by_pip = (programs / "pip", "install", "--quiet", "--no-compile")
    install = by_pip if version == PYTHONS[0] else installer(programs)
    assert shutil.which("gcc", path=alone) is None
    run(*install, "--only-binary=:all:", wheel(dist, "x86_64"), path=alone)
    check_decoded(run(programs / "ledpi", "decode", "--single-frame", take, path=alone))
    config = ("--config", tmp_path / "config.yaml", "--set", "camera.source=simulated")
    run(programs / "ledpi", "config", "init", tmp_path / "config.yaml", path=alone)
    assert "✓ panels             ID 7, 23 read" in run(programs / "ledpi", "doctor", *config, path=alone)
    run(programs / "ledpi", "run", *config, "--set", "tap.socket=null", "--frames", "30", path=alone)
    program = "import ledpi; print(ledpi.__version__, ledpi.Reader(side_m=0.16).rejected)"
    assert run(programs / "python", "-c", program, path=alone) == f"{__version__} {{}}\n"


@pytest.mark.nightly  # the wheels are built from it
def test_the_source_package_installs(dist: Path, take: Path, tmp_path: Path) -> None:
    """Needs a compiler."""
    programs = environment(tmp_path / "venv")
    run(*installer(programs), "--no-binary=ledpi", dist / f"ledpi-{__version__}.tar.gz")
    check_decoded(run(programs / "ledpi", "decode", "--single-frame", take))


@slow
def test_the_wheel_for_arm_decodes_alike(dist: Path, take: Path, tmp_path: Path) -> None:
    """In an emulator of 64-bit ARM. Its core has loops of its own, other ones for deep bands and for streams.

    A first frame's pose has the covariance that the core for x86-64 gives it, but for rounding.
    """
    short = tmp_path / "short"
    drawn = ("--distance", "0.6", "--id", "7", "--frames", "2", "--exposure-us", "150")
    run(sys.executable, "-m", "ledpi", "simulate", short, *drawn)
    alone = ["decode", "--single-frame", str(take)]
    printed = [
        run(ROOT / "scripts/emulated-aarch64", wheel(dist, "aarch64"), *options)
        for options in (alone, ["decode", short])
    ]
    for each in printed:
        check_decoded(each)
    here = run(sys.executable, "-m", "ledpi", *alone)
    arm, other = ([frame["markers"][0]["covariance"][::7] for frame in frames(each)] for each in (printed[0], here))
    assert np.sqrt(arm) == pytest.approx(np.sqrt(other), rel=0.02)


@slow
def test_instructions_are_counted_on_arm(dist: Path) -> None:
    """Between a program's own marks, in the emulator."""
    check_counted(counting.on_aarch64(wheel(dist, "aarch64"), ["-c", PROGRAM]))


@pytest.mark.nightly  # what others' packages weigh changes with none of ours
def test_the_demo_does_not_download_much(dist: Path, tmp_path: Path) -> None:
    """All that ledpi itself needs, as scripts/demo installs it."""
    programs = environment(tmp_path / "venv")
    assert 'make_venv .venv ""' in (ROOT / "scripts/demo").read_text(encoding="utf-8")
    run(programs / "pip", "download", "--quiet", "--dest", tmp_path / "all", wheel(dist, "x86_64"), "setuptools")
    size = sum(path.stat().st_size for path in (tmp_path / "all").iterdir())
    assert size < DEMO_MB * 1e6
