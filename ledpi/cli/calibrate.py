"""`ledpi calibrate …`: the group that holds what measures the camera and the panels; one file a command."""

from __future__ import annotations

import typer

from ledpi.cli import app

calibrate = typer.Typer(help="Measures the camera and the panels.", no_args_is_help=True, rich_markup_mode=None)
app.add_typer(calibrate, name="calibrate")


@calibrate.callback()
def _group() -> None:
    """Keeps each command one of its own while it is the only one."""
