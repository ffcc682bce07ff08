"""`ledpi map`: a map of panels from and to WPILib's field layout, and from Limelight's field map."""

from __future__ import annotations

import math
from pathlib import Path

import typer

from ledpi.cli import CONFIG, app
from ledpi.config.check import unreadable_note
from ledpi.config.map_yaml import layout_text, load_layout, load_map, map_text
from ledpi.config.settings import find_config, load_config
from ledpi.core.errors import ConfigError, LedpiError
from ledpi.core.wording import counted
from ledpi.workshop.calibrate.files import write_keeping_old

_OUT = "File to write; an older one is kept as NAME.bak-1."

map_app = typer.Typer(
    name="map",
    help="Maps of panels, from and to WPILib's AprilTag field layout.\n\n"
    "Example: ledpi map import 2024-crescendo.json markers.yaml",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(map_app)


@map_app.command("import")
def import_(
    layout: Path = typer.Argument(metavar="LAYOUT", help="WPILib's field layout (JSON), or Limelight's .fmap."),
    out: Path = typer.Argument(Path("markers.yaml"), metavar="OUT", help=_OUT),
    config: Path | None = CONFIG,
) -> None:
    """WPILib's AprilTag field layout, or Limelight's → markers.yaml.

    WPILib's origin is a corner of the field, Limelight's is the middle. WPILib's layout holds no sizes. IDs that the
    configuration's dictionary does not have are imported, and named.

    Example: ledpi map import 2024-crescendo.json markers.yaml
    """
    panels, settings, wrong = load_layout(layout), None, ""
    try:
        settings = load_config(find_config(config), without_file=("panels.side_m=1",))
    except LedpiError as error:
        if config is not None:
            raise
        wrong = str(error)
    kept = write_keeping_old(out, map_text(panels, f"From {layout.name}, a field layout."))
    typer.echo(_written(out, len(panels), kept))
    if settings is None:
        typer.echo(f"Whether panels of these IDs are read was not looked at: {wrong}")
    elif note := unreadable_note(settings.panels, panels, out):
        typer.echo(note)


@map_app.command()
def export(
    markers: Path = typer.Argument(metavar="MAP", help="The map, as in markers.yaml."),
    out: Path = typer.Argument(Path("layout.json"), metavar="OUT", help=_OUT),
    field: tuple[float, float] = typer.Option(
        (16.54, 8.21), metavar="LENGTH WIDTH", help="Size of the field, in metres."
    ),
) -> None:
    """markers.yaml → WPILib's AprilTag field layout.

    PhotonVision and robot code read it. The layout holds no panel sizes.

    Example: ledpi map export markers.yaml layout.json --field 12 8
    """
    if not all(math.isfinite(metres) and metres > 0 for metres in field):
        raise ConfigError(f"--field {field[0]:g} {field[1]:g}: must be two lengths above 0, in metres")
    panels = load_map(markers)
    kept = write_keeping_old(out, layout_text(panels, field))
    typer.echo(_written(out, len(panels), kept))


def _written(out: Path, panels: int, kept: Path | None) -> str:
    return f"{out} written, {counted(panels, 'panel')}" + (f"; the older one is kept as {kept}" if kept else "")
