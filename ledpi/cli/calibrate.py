"""`ledpi calibrate …`: the group that holds what measures the camera and the panels; one file a command."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ledpi.cli import app

if TYPE_CHECKING:
    from ledpi.config import Config

calibrate = typer.Typer(help="Measures the camera and the panels.", no_args_is_help=True, rich_markup_mode=None)
app.add_typer(calibrate, name="calibrate")


@calibrate.callback()
def _group() -> None:
    """Keeps each command one of its own while it is the only one."""


def settings_for(config: Path | None, set_: list[str], recording: Path | None) -> tuple[Config, Path | None]:
    """The configuration, with a recording as its camera if one is given, and the file that it came from."""
    from ledpi.config import find_config, load_config

    file = find_config(config)
    overrides = list(set_)
    if recording is not None:
        overrides.append(f"camera.source=recording:{recording}")
        if file is None and not any(item.startswith("panels.side_m=") for item in set_):
            overrides.append("panels.side_m=1")  # the recording brings its own, and nothing here depends on it
    return load_config(file, tuple(overrides)), file
