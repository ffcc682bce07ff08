"""The command line: one file a command. Each imports what it needs only when it is called."""

from __future__ import annotations

import io
import logging
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, NoReturn

# Matrices and pictures here are small: a second thread costs more to wake than it saves (a busy core made the edges of
# one panel take 9 ms, not 1), and the daemon's threads have the other cores. Before numpy and OpenCV are loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")
# What is wrong with a picture is said by ledpi, in one line.
os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # FFmpeg's AV_LOG_QUIET
# It decodes no picture that is larger: of any format, and before it asks for the memory.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", "25000000")  # the square of config.values.MAX_SIDE_PX

import typer
from typer.core import TyperCommand
from typer.main import get_command

from ledpi import __version__
from ledpi.core.errors import LedpiError, TransientError, one_line
from ledpi.core.files import FULL, MAKE_ROOM

# What the option parser raises; typer has it from click, or from a copy of click's that it brings along.
_CommandLineError: type[Exception] = typer.BadParameter.__mro__[1]

app = typer.Typer(
    name="ledpi",
    help="""The lighting is the marker: reads blinking LED panels with a rolling-shutter camera.

    Example: ledpi run --set camera.source=simulated --set serial.port=/tmp/robot
    """,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    # A wide terminal shows examples in one line, to be copied.
    context_settings={"max_content_width": 120, "help_option_names": ["-h", "--help"]},
)


# The options that most commands have: `config: Path | None = CONFIG, set_: list[str] = SET`.
CONFIG: Path | None = typer.Option(None, "--config", help="Default: ./config.yaml, /etc/ledpi/config.yaml.")
SET: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Overrides a key of the configuration.")
METHOD: str | None = typer.Option(None, "--method", help="Overrides decode.method: likelihood or uemura.")

# Each command's line in the help of all, where no other module is loaded.
COMMANDS = {
    "backup": "Configuration, lens, map and udev rule → one file.",
    "bridge": "Send poses to MQTT, NetworkTables, ROS 2, MAVLink, UDP or TCP.",
    "decode": "Recordings or pictures → one JSON object a frame.",
    "doctor": "One page of ✓ and ✗, each ✗ with what to do.",
    "evaluate": "Measure how often and how exactly your own panel is read.",
    "export": "A recording as an MCAP bag, with what was read and where.",
    "import": "A bag or a video as a recording, for `ledpi decode`.",
    "monitor": "Watch the running daemon, or print the serial stream.",
    "record": "Record the camera at its full rate, and decode live meanwhile.",
    "restore": "Put back what `ledpi backup` saved.",
    "rewind": "Save the running daemon's last seconds as a recording.",
    "run": "The daemon: camera to serial line, until Ctrl-C or SIGTERM.",
    "simulate": "Simulated panels → a recording, with the truth.",
    "snapshot": "One frame as an annotated picture.",
    "view": "A web page of what the running daemon sees.",
    "calibrate": "Measure the camera and the panels.",
    "config": "Write, show, check and change config.yaml.",
    "map": "Maps of panels, from and to WPILib's AprilTag field layout.",
    "panel": "Design and build panels.",
}
_MODULES = {"import": "bags", "export": "bags", "restore": "backup"}  # that are not called as their command


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(f"ledpi {__version__}")
        raise typer.Exit


@app.callback()
def _ledpi(
    version: bool = typer.Option(False, "--version", is_eager=True, callback=_show_version, help="Show the version."),
) -> None:
    """Answers what can be asked without a command."""


@contextmanager
def progress(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """Shows a bar on standard error, where that is a terminal. Yields the function that says how many more are done."""
    if not sys.stderr.isatty():
        yield lambda count: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    # rich prints standard output above the bar, by way of its console; where that is a file it would stay empty.
    shared = sys.stdout.isatty()
    with Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=shared) as bar:
        task = bar.add_task(what, total=total)
        yield lambda count: bar.advance(task, count)


def main(loaded: Callable[[], None] = lambda: None, command: typer.Typer = app, name: str = "ledpi") -> None:
    """Runs a command. What a user can put right is one line on standard error and exit status 2, or 1 where trying
    again may help. So is what the operating system refuses and no command has foreseen. After Ctrl-C it is 130.

    `loaded` is called once every command is there, before one begins.
    """
    if logging.lastResort is not None:  # where a command keeps no log of its own, warnings look as errors do
        logging.lastResort.setFormatter(_OneLine("ledpi: %(message)s"))
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a terminal that is not UTF-8 has no ✓
    try:
        _add_commands()
        loaded()
        group = get_command(command)
        try:  # by itself it says in four lines what is wrong
            status = (_with_all(group) if command is app else group)(prog_name=name, standalone_mode=False)
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()  # here, as Python itself could only print a traceback at the end
    except LedpiError as error:
        _end(str(error), 1 if isinstance(error, TransientError) else 2)
    except OSError as error:  # a name that is too long, or a full disk behind `> file`
        # Of all that has no name only the working directory can be missing.
        nameless = "the working directory" if isinstance(error, FileNotFoundError) else "standard output"
        full = FULL.get(error.errno or 0)
        said = error.strerror or error if full is None else f"{full}; {MAKE_ROOM}"
        _end(f"{error.filename or nameless}: {said}", 2 if full is None else 1)
    except _CommandLineError as error:
        _end_usage(error)
    except KeyboardInterrupt:  # before a command has begun; typer sees to the later ones
        sys.exit(130)
    sys.exit(status)


class _OneLine(logging.Formatter):
    """Keeps a warning in one line, where the file that it names has a line break in its name."""

    def format(self, record: logging.LogRecord) -> str:
        return one_line(super().format(record))


def _add_commands() -> None:
    """Imports the modules of the commands that are named, or to be completed: what computes takes a second to load."""
    completed = (os.environ.get(name, "") for name in ("COMP_WORDS", "_TYPER_COMPLETE_ARGS"))
    words = {*sys.argv, *" ".join(completed).split()}
    for module in {_MODULES.get(name, name) for name in COMMANDS if name in words}:
        for part in iter_modules(__path__):  # a group has one for each of its commands, too
            if part.name == module or part.name.startswith(f"{module}_"):
                import_module(f"ledpi.cli.{part.name}")


def _with_all(group: Any) -> Any:
    """Gives the others a place in the help, with a line each."""
    for name, line in COMMANDS.items():
        group.commands[name] = group.commands.pop(name, None) or TyperCommand(name, help=line)
    return group


def _end_usage(error: Any) -> NoReturn:
    """Says in one line which word of the command cannot be. A bare `ledpi`, or `ledpi panel`, gives its help."""
    if type(error).__name__ == "NoArgsIsHelpError":
        error.show()
        sys.exit(2)
    said = " ".join(error.format_message().split()).removesuffix(".")
    said = said.replace("Value error, ", "").replace("Input should", "must")
    said = said[:1].lower() + said[1:]
    if error.ctx is None:
        _end(said, 2)
    command = error.ctx.command_path
    _end(f"{said}; try '{command} --help'", 2, command)


def _end(message: str, status: int, command: str = "ledpi") -> NoReturn:
    """Says in one line why it ends."""
    print(f"{command}: {one_line(message)}", file=sys.stderr)
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:  # what could not be written is given up, or Python would try once more
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(status)
