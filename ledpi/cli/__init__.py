"""The command line: one file a command. Each imports what it needs only when it is called."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable

# Matrices and pictures here are small: a second thread costs more to wake than it saves (a busy core made the edges of
# one panel take 9 ms, not 1), and the daemon's threads have the other cores. Before numpy and OpenCV are loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")
# What is wrong with a picture is said by ledpi, in one line.
os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")

import typer

from ledpi import __version__
from ledpi.errors import CameraLostError, LedpiError
from ledpi.wording import one_line

app = typer.Typer(
    name="ledpi",
    help="The lighting is the marker: reads blinking LED panels with a rolling-shutter camera.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"max_content_width": 120},  # a wide terminal shows examples in one line, to be copied
)


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(f"ledpi {__version__}")
        raise typer.Exit


@app.callback()
def _ledpi(
    version: bool = typer.Option(False, "--version", is_eager=True, callback=_show_version, help="Show it and exit."),
) -> None:
    """What can be asked without a command."""


def main(loaded: Callable[[], None] = lambda: None) -> None:
    """Runs a command. What a user can put right is one line on standard error and exit status 2, or 1 where trying
    again may help. So is what the operating system refuses and no command has foreseen. After Ctrl-C it is 130.

    `loaded` is called once every command is there, before one begins.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a terminal that is not UTF-8 has no ✓
    try:
        _add_commands()
        loaded()
        try:
            app()
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()  # here, as Python itself could only print a traceback at the end
    except LedpiError as error:
        _end(str(error), 1 if isinstance(error, CameraLostError) else 2)
    except OSError as error:  # a name that is too long, or a full disk behind `> file`
        _end(f"{error.filename or 'standard output'}: {error.strerror or error}", 2)
    except KeyboardInterrupt:  # before a command has begun; typer sees to the later ones
        sys.exit(130)


def _add_commands() -> None:
    from ledpi.cli import (  # noqa: F401, each adds its command to `app`
        calibrate,
        calibrate_board,
        calibrate_camera,
        calibrate_map,
        calibrate_panel,
        calibrate_shutter,
        decode,
        doctor,
        evaluate,
        map,
        monitor,
        panel,
        panel_design,
        panel_firmware,
        panel_sheet,
        record,
        run,
        simulate,
        snapshot,
    )

    app.registered_commands.sort(key=lambda command: command.callback.__name__ if command.callback else "")


def _end(message: str, status: int) -> None:
    """Says in one line why it ends."""
    print(f"ledpi: {one_line(message)}", file=sys.stderr)
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:  # what could not be written is given up, or Python would try once more
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(status)
