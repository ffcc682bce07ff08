"""The command's entry point: what it says of itself, and that Ctrl-C ends it quietly before there is a command, too."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from ledpi import __version__
from ledpi.__main__ import main
from tests.builders import ROOT
from tests.builders.command import in_process
from tests.builders.daemon import write_recording
from tests.builders.waiting import limit_s

CTRL_C = "import signal\nsignal.raise_signal(signal.SIGINT)\n"
# Exceptions in an import may be caught there: by importlib itself, or where a module has a substitute.
CTRL_C_CAUGHT = "try:\n    import signal; signal.raise_signal(signal.SIGINT)\nexcept BaseException:\n    pass\n"
RUN = ["--set", "camera.source=simulated", "--set", "tap.socket=null", "--frames", "2"]
WENT_ON = "raise SystemExit(7)\n"


def console_script() -> str:
    """Returns what the command `ledpi` is once it is installed."""
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    (module, function), *_ = re.findall(r'^ledpi = "([\w.]+):(\w+)"$', project, re.MULTILINE)
    return f"import sys; from {module} import {function}; sys.exit({function}())"


def ended(arguments: list[str], folder: Path, typer: str, *, ignoring: bool = False) -> tuple[int, str]:
    """Exit status and standard error, where this is the `typer` that the command line loads first of all."""
    (folder / "typer.py").write_text(typer, encoding="utf-8")
    done = subprocess.run(
        ["env", "--ignore-signal=INT", sys.executable, *arguments] if ignoring else [sys.executable, *arguments],
        env=os.environ | {"PYTHONPATH": f"{folder}:{ROOT}"},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=limit_s(30),
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize("typer", [CTRL_C, CTRL_C_CAUGHT + WENT_ON])
@pytest.mark.parametrize("arguments", [["-m", "ledpi"], ["-c", console_script()]], ids=["module", "command"])
def test_ctrl_c_while_modules_are_loaded_ends_quietly(tmp_path: Path, arguments: list[str], typer: str) -> None:
    """With the status of every Ctrl-C, also where the import that it falls into would go on."""
    assert ended(arguments, tmp_path, typer) == (130, "")


@pytest.mark.parametrize(
    ("package", "command"),
    [("yaml", ["decode", "take"]), pytest.param("serial", ["run", *RUN], marks=pytest.mark.slow)],
)
def test_another_package_of_the_name_is_told_in_one_line(tmp_path: Path, package: str, command: list[str]) -> None:
    """As an environment of ROS brings it: which file, and what to do, with status 2."""
    status, _, errors = with_an_empty(package, tmp_path, *command)
    said = f"ledpi: {package} cannot be used: {tmp_path}/{package}/__init__.py: module '{package}' has no attribute"
    assert (status, errors.count("\n")) == (2, 1)
    assert errors.startswith(said)
    assert "unset PYTHONPATH" in errors


def test_doctor_goes_on_without_a_package(tmp_path: Path) -> None:
    """To the end of its page."""
    status, said, _ = with_an_empty("yaml", tmp_path, "doctor")
    assert status == 1
    assert f"✗ packages           yaml cannot be used: {tmp_path}/yaml/__init__.py" in said
    assert said.splitlines()[-1] == "`ledpi run` would not run: packages"


def with_an_empty(package: str, folder: Path, *words: str) -> tuple[int, str, str]:
    """Exit status, standard output and error of a command that finds this package first."""
    (folder / package).mkdir()
    (folder / package / "__init__.py").touch()
    environment = os.environ | {"PYTHONPATH": f"{folder}:{ROOT}"}
    command = [sys.executable, "-m", "ledpi", *words]
    done = subprocess.run(
        command, env=environment, cwd=folder, capture_output=True, text=True, check=False, timeout=limit_s(30)
    )
    return done.returncode, done.stdout, done.stderr


def test_where_ctrl_c_is_ignored_it_stays_so(tmp_path: Path) -> None:
    """As a shell does for what it runs in the background."""
    assert ended(["-m", "ledpi"], tmp_path, CTRL_C + WENT_ON, ignoring=True) == (7, "")


def test_a_command_sees_ctrl_c_as_an_exception(monkeypatch: pytest.MonkeyPatch) -> None:
    """Once everything is loaded: cameras and files are open then, and are to be closed."""

    def command_line(loaded: Callable[[], None]) -> None:
        assert signal.getsignal(signal.SIGINT) is not signal.default_int_handler
        loaded()
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("ledpi.cli.main", command_line)
    with pytest.raises(KeyboardInterrupt):
        main()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.slow
def test_a_terminal_that_is_not_utf_8_gets_escapes() -> None:
    """It has no ✓, and no …; a traceback would be of no use there."""
    done = subprocess.run(
        [sys.executable, "-m", "ledpi", "doctor", "--config", "none"],
        env=os.environ | {"PYTHONIOENCODING": "latin-1"},
        cwd=ROOT,
        capture_output=True,
        timeout=limit_s(30),
    )
    assert (done.returncode, done.stderr) == (1, b"")
    assert done.stdout.startswith(b"\\u2717 configuration")


@pytest.mark.slow
def test_it_says_its_version() -> None:
    """As a report of a fault needs it."""
    done = subprocess.run(
        [sys.executable, "-m", "ledpi", "--version"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=limit_s(30),
    )
    assert done.stdout == f"ledpi {__version__}\n"


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("nonsense", "ledpi: no such command 'nonsense'"),
        ("decode", "ledpi decode: missing argument 'PATH…'"),
        ("panel design --nonsense", "ledpi panel design: no such option: --nonsense"),
        ("evaluate --method nonsense", "ledpi evaluate: invalid value for '--method': 'nonsense' is not one of "),
        ("simulate out --frames many", "ledpi simulate: invalid value for '--frames': "),
        ("monitor a b", "ledpi monitor: got unexpected extra argument"),
        ("run --set", "ledpi: option '--set' requires an argument"),
    ],
)
def test_a_word_that_cannot_be_is_reported_in_one_line(
    command: str, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the command's name, and status 2."""
    status, output, errors = in_process(monkeypatch, capsys)(*command.split())
    (line,) = errors.splitlines()
    assert (status, output) == (2, "")
    assert line.startswith(said)
    name = said.partition(":")[0]
    assert line.endswith(f"; try '{name} --help'") or line == said


@pytest.mark.parametrize("command", [[], ["panel"]])
def test_a_name_alone_gives_its_help(
    command: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Takes that of a command which has others below it."""
    _, output, errors = in_process(monkeypatch, capsys)(*command)
    assert (output + errors).startswith(" ".join(["Usage: ledpi", *command, "[OPTIONS] COMMAND"]))


@pytest.mark.slow
def test_a_warning_looks_as_an_error_does(tmp_path: Path) -> None:
    """Here of a recording that was cut off; its frames are decoded."""
    take = tmp_path / "take\nold"
    write_recording(take, 2)
    lines = (take / "frames.jsonl").read_text(encoding="utf-8")
    (take / "frames.jsonl").write_text(lines[:-9], encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "ledpi", "decode", take],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=limit_s(30),
    )
    assert len(done.stdout.splitlines()) == 1
    assert done.stderr.startswith(f"ledpi: {tmp_path}/take\\nold/frames.jsonl: line 2: is cut off; ")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("command", [(), ("panel",), ("panel", "design"), ("run",)])
def test_help_is_asked_for_in_short_too(
    command: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As of most programs."""
    status, out, _ = in_process(monkeypatch, capsys)(*command, "-h")
    assert (status, out.startswith("Usage: ")) == (0, True)


@pytest.mark.slow
@pytest.mark.parametrize(("typed", "completed"), [("ledpi ca", "calibrate"), ("ledpi panel f", "firmware")])
def test_a_shell_can_complete_commands(typed: str, completed: str) -> None:
    """As `ledpi --install-completion` sets it up for bash."""
    asked = {"_LEDPI_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(typed.count(" "))}
    done = subprocess.run(
        [sys.executable, "-c", console_script()],
        env=os.environ | asked,
        capture_output=True,
        text=True,
        timeout=limit_s(30),
    )
    assert done.stdout.split() == [completed]
