"""The command line: one file a command. Each imports what it needs only when it is called."""

from __future__ import annotations

import os
import sys

# Matrices and pictures here are small: a second thread costs more to wake than it saves (a busy core made the edges of
# one panel take 9 ms, not 1), and the daemon's threads have the other cores. Before numpy and OpenCV are loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")

import typer

from ledpi.errors import CameraLostError, LedpiError

app = typer.Typer(
    name="ledpi",
    help="The lighting is the marker: reads blinking LED panels with a rolling-shutter camera.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def main() -> None:
    """Entry point. A LedpiError is one line on standard error and exit status 2, or 1 where trying again may help."""
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

    try:
        app()
    except LedpiError as error:
        print(f"ledpi: {error}", file=sys.stderr)
        sys.exit(1 if isinstance(error, CameraLostError) else 2)
