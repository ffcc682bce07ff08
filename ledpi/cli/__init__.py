"""The command line: one file a command. Each imports what it needs only when it is called."""

from __future__ import annotations

import io
import logging
import os
import sys
from collections.abc import Callable
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

from ledpi import __version__
from ledpi.core.errors import LedpiError, TransientError
from ledpi.core.files import FULL, MAKE_ROOM
from ledpi.core.wording import one_line

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


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(f"ledpi {__version__}")
        raise typer.Exit


@app.callback()
def _ledpi(
    version: bool = typer.Option(False, "--version", is_eager=True, callback=_show_version, help="Show the version."),
) -> None:
    """Answers what can be asked without a command."""


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
        try:
            status = command(prog_name=name, standalone_mode=False)  # by itself it says in four lines what is wrong
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
    from ledpi.cli import (  # noqa: F401, each adds its command to `app`
        backup,
        bridge,
        calibrate,
        calibrate_board,
        calibrate_camera,
        calibrate_map,
        calibrate_panel,
        calibrate_shutter,
        config,
        decode,
        doctor,
        evaluate,
        export,
        import_,
        map,
        monitor,
        panel,
        panel_design,
        panel_firmware,
        panel_sheet,
        record,
        rewind,
        run,
        simulate,
        snapshot,
        view,
    )

    app.registered_commands.sort(key=lambda command: command.callback.__name__ if command.callback else "")


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
