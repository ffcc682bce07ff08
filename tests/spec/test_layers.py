"""The layers: what computes knows no files, clocks, threads or devices; `run` loads no workshop tools."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest

from tests.builders import ROOT
from tests.builders.imports import RUN, file_of, imports_of, reached_from

# Whole packages by a trailing dot; each with everything that it imports from ledpi.
PURE = [
    "ledpi.decode.",
    "ledpi.pose.",
    "ledpi.state.",
    "ledpi.core.lens",
    "ledpi.core.library",
    "ledpi.core.codewords",
    "ledpi.core.shutter",
    "ledpi.core.geometry",
    "ledpi.core.records",
    "ledpi.pipeline.output",
    "ledpi.pipeline.trace",
    "ledpi.pipeline.diagnosis.look",
    "ledpi.daemon.tap.protocol",
    "ledpi.wire.message",
    "ledpi.wire.codec",
    "ledpi.wire.keeper",
    "ledpi.wire.outbox",
    "ledpi.wire.mavlink",
    "ledpi.camera.gain",
    "ledpi.camera.timing",
    "ledpi.camera.tuning",
    "ledpi.page.encode",
    "ledpi.page.guard",
    "ledpi.page.lines",
    "ledpi.page.metrics",
    "ledpi.links.ros.contents",
    "ledpi.links.photon",
    "ledpi.links.wpilib_values",
    "ledpi.workshop.calibrate.bands",
    "ledpi.workshop.calibrate.boards",
    "ledpi.workshop.calibrate.camera",
    "ledpi.workshop.calibrate.collecting",
    "ledpi.workshop.calibrate.lamp",
    "ledpi.workshop.calibrate.map",
    "ledpi.workshop.calibrate.shutter",
    "ledpi.workshop.panel.body",
    "ledpi.workshop.panel.circuit",
]
IMPURE_MODULES = {
    *("threading", "multiprocessing", "concurrent", "asyncio", "queue", "signal", "subprocess"),
    *("time", "datetime"),
    *("os", "pathlib", "io", "shutil", "tempfile", "glob", "yaml"),
    *("socket", "select", "serial", "picamera2", "libcamera", "ledpi.camera"),
}
IMPURE_CALLS = {"open", "imread", "imwrite", "VideoCapture", "fromfile", "tofile", "save", "savez", "input"}

# From the ground up: a package imports those before it. Workshop tools may use each other.
LAYERS = (
    *("core", "pose", "state", "decode", "config", "camera", "pipeline", "wire", "daemon", "links", "workshop"),
    *("page", "cli"),
)

WORKSHOP = {"ledpi.workshop", "scipy", "matplotlib"}


def is_one_of(name: str, modules: set[str]) -> bool:
    return any(name == module or name.startswith(module + ".") for module in modules)


def breaches(modules: Iterable[str], forbidden: set[str], root: Path = ROOT, stop_at: str = "") -> list[str]:
    """`module imports name` for each forbidden import on the way."""
    return [
        f"{module} imports {name}"
        for module, names in sorted(reached_from(modules, root, stop_at).items())
        for name in sorted(names)
        if is_one_of(name, forbidden)
    ]


def members(entry: str) -> list[str]:
    """A module, or every module of a package."""
    if not entry.endswith("."):
        return [entry]
    folder = ROOT.joinpath(*entry.split("."))
    return [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in sorted(folder.rglob("*.py"))]


def called_names(path: Path) -> set[str]:
    """The last part of whatever a file calls: `imread` for cv2.imread(…)."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    calls = [ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return {call.split(".")[-1] for call in calls}


def test_what_computes_is_pure() -> None:
    """No threads, clocks, files, serial port or camera there, nor in anything that it imports."""
    of_entries = {entry: members(entry) for entry in PURE}
    assert [entry for entry, modules in of_entries.items() if not modules or not all(map(file_of, modules))] == []
    assert breaches({module for modules in of_entries.values() for module in modules}, IMPURE_MODULES) == []


def test_what_computes_touches_no_file() -> None:
    """Files can also be opened without an import that shows it; those calls are not made either."""
    modules = reached_from({module for entry in PURE for module in members(entry)})
    called = {module: called_names(file_of(module) or ROOT) & IMPURE_CALLS for module in modules}
    assert {module: names for module, names in called.items() if names} == {}


def test_imports_go_one_way() -> None:
    """A package imports only those that stand below it."""
    upwards = {
        f"{module} imports {name}"
        for level, package in enumerate(LAYERS)
        for module in members(f"ledpi.{package}.")
        for name in imports_of(file_of(module) or ROOT)
        if name.startswith("ledpi.") and name.split(".")[1] not in {*LAYERS[: level + 1], "__version__"}
    }
    assert upwards == set()


def test_what_is_installed_does_without_what_is_not() -> None:
    """Neither tests nor evaluation/ are in the wheel."""
    modules = members("ledpi.")
    assert breaches(modules, {"evaluation", "tests"}) == []


def test_every_package_has_its_layer() -> None:
    """Nothing lies loose beside them but what Python asks for."""
    folder = ROOT / "ledpi"
    assert {path.parent.name for path in folder.glob("*/__init__.py")} == set(LAYERS)
    assert {path.name for path in folder.glob("*.py")} == {"__init__.py", "__main__.py"}


def test_no_file_is_a_scrap_or_a_tome() -> None:
    """Each answers one question, in 40 to 300 lines; an __init__ in as few as it likes."""
    lines = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in (ROOT / "ledpi").rglob("*.py")}
    named = {str(path.relative_to(ROOT)): n for path, n in lines.items() if path.name != "__init__.py"}
    assert {path: n for path, n in named.items() if not 40 <= n <= 300 and "shipped-files" not in path} == {}


def test_records_import_numpy_only() -> None:
    """The records stand below everything else."""
    path = file_of("ledpi.core.records")
    assert path is not None
    foreign = {name.split(".")[0] for name in imports_of(path)} - set(sys.stdlib_module_names)
    assert foreign == {"numpy"}


def test_run_reaches_no_workshop_tool() -> None:
    """`run` leads to no calibration, panel design or evaluation. (Other commands stand behind ledpi.cli.)"""
    assert [module for module in RUN if not file_of(module)] == []  # where one is gone, this test must follow
    assert breaches(RUN, WORKSHOP, stop_at="ledpi.cli") == []


@pytest.mark.slow
def test_run_loads_no_workshop_tool() -> None:
    """With all loaded that `run` may ever load, no library has brought scipy or matplotlib in."""
    modules = sorted(reached_from(RUN, stop_at="ledpi.cli"))
    script = f"import importlib, sys; [importlib.import_module(m) for m in {modules}]; print(*sys.modules)"
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert "cv2" in done.stdout.split()
    assert [name for name in done.stdout.split() if is_one_of(name, WORKSHOP)] == []


def test_a_breach_two_steps_away_is_seen(tmp_path: Path) -> None:
    """The checks themselves: an import inside a function of a module that is only reached through another."""
    package = tmp_path / "ledpi"
    package.mkdir()
    (package / "a.py").write_text("from ledpi import b\n")
    (package / "b.py").write_text("def f():\n    from ledpi.c import g\n    return g\n")
    (package / "c.py").write_text("import numpy\ndef g():\n    import os.path\n    return os.path\n")
    assert breaches(["ledpi.a"], {"os"}, tmp_path) == ["ledpi.c imports os.path"]
    assert breaches(["ledpi.a"], {"os"}, tmp_path, stop_at="ledpi.c") == []


@pytest.mark.slow
def test_a_command_computes_on_one_thread() -> None:
    """OpenCV's and BLAS's threads wait for each other longer than these small pictures take."""
    code = "import ledpi.cli, cv2; print(cv2.getNumThreads())"
    plain = {key: value for key, value in os.environ.items() if not key.startswith("OPENCV_")}
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=plain, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "1"
