"""`ledpi panel …`: the group that holds what designs, draws and drives the panels; one file a command."""

from __future__ import annotations

import typer

from ledpi.cli import app

panel = typer.Typer(
    help="Design and build panels.\n\nExample: ledpi panel sheet 7 --out sheet",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(panel, name="panel")


@panel.callback()
def _group() -> None:
    """Keeps each command one of its own while it is the only one."""
