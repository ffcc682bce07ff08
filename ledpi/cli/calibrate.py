"""`ledpi calibrate …`: the group that holds what measures the camera and the panels; one file a command."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ledpi.cli import app
from ledpi.core.errors import CalibrationError

if TYPE_CHECKING:
    from ledpi.config.panels import PanelSettings
    from ledpi.config.settings import Config
    from ledpi.core.records import PanelSpec, Pixels

calibrate = typer.Typer(rich_markup_mode=None)
app.add_typer(calibrate, name="calibrate")


@calibrate.callback(invoke_without_command=True)
def status(
    context: typer.Context,
    config: Path | None = typer.Option(None, "--config", help="Default: ./config.yaml, /etc/ledpi/config.yaml."),
) -> None:
    """Measure the camera and the panels. Without a command: what is calibrated, how well, and what comes next.

    Example: ledpi calibrate
    """
    if context.invoked_subcommand is not None:
        return
    from datetime import date

    from ledpi.tools.calibrate.status import next_command, parts

    settings, file = settings_for(config, [], None)
    typer.echo(
        f"{file}:" if file is not None else "no config.yaml; these are the defaults (ledpi config init writes one)"
    )
    found = list(parts(settings, date.today()))
    for part in found:
        typer.echo(f"  {part.name:8} {part.text}")
    command = next_command(found)
    typer.echo(f"next: {command}" if command is not None else "nothing is missing")


def settings_for(config: Path | None, set_: list[str], recording: Path | None) -> tuple[Config, Path | None]:
    """The configuration, with a recording as its camera if one is given, and the file that it came from."""
    from ledpi.config.settings import find_config, load_config

    file = find_config(config)
    overrides = list(set_)
    if recording is not None:
        overrides.append(f"camera.source=recording:{recording}")
    own_size = ("panels.side_m=1",)  # it has no part in what is measured here
    return load_config(file, tuple(overrides), without_file=own_size), file


def name_in_config(file: Path, key: tuple[str, ...], written: Path) -> str:
    """Puts the name of a file that was written into the configuration; what to say of that."""
    from ledpi.tools.calibrate.config_file import change_config

    beside = written.resolve().parent == file.resolve().parent  # paths in the file are relative to it
    place = written.name if beside else str(written.resolve())
    kept = change_config(file, {key: place})
    return f"{file}: {'.'.join(key)}: {place} written; the older one is kept as {kept}"


def announced_specs(panels: PanelSettings) -> list[PanelSpec]:
    """Every pair of frequencies that a panel is announced with, the common one first."""
    specs = [panels.spec(), *(panels.spec(marker_id) for marker_id in panels.overrides)]
    return list({(spec.black_hz, spec.white_hz): spec for spec in reversed(specs)}.values())[::-1]


def read_grey(path: Path) -> Pixels:
    """A picture file as grey values (H, W). Raises CalibrationError where it is none."""
    from ledpi.core.files import read_bytes
    from ledpi.recording.picture import MAX_BYTES
    from ledpi.recording.still import decode_grey

    picture = decode_grey(read_bytes(path, CalibrationError, MAX_BYTES))
    if picture is None:
        raise CalibrationError(f"{path}: is not a picture that can be decoded")
    return picture
