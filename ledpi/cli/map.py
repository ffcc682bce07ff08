"""`ledpi map`: a map of panels from and to WPILib's field layout."""

from __future__ import annotations

from pathlib import Path

import typer

from ledpi.cli import app

map_app = typer.Typer(
    name="map",
    help="Maps of panels: markers.yaml from and to WPILib's AprilTag field layout.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(map_app)


@map_app.command("import")
def import_(
    layout: Path = typer.Argument(help="Field layout, JSON."),
    out: Path = typer.Argument(Path("markers.yaml"), help="File to write; an older one is kept as NAME.bak-1."),
) -> None:
    """WPILib's AprilTag field layout → markers.yaml.

    Example: ledpi map import 2024-crescendo.json markers.yaml
    """
    from ledpi.calibrate.files import write_keeping_old
    from ledpi.map_wpilib import load_layout
    from ledpi.map_yaml import map_text

    panels = load_layout(layout)
    kept = write_keeping_old(out, map_text(panels, f"From {layout.name}, a field layout of WPILib's."))
    typer.echo(f"{out} written, {len(panels)} panels" + (f"; the older one is kept as {kept}" if kept else ""))


@map_app.command()
def export(
    markers: Path = typer.Argument(help="markers.yaml."),
    out: Path = typer.Argument(Path("layout.json"), help="File to write; an older one is kept as NAME.bak-1."),
    field: tuple[float, float] = typer.Option((16.54, 8.21), help="Length and width of the field, in metres."),
) -> None:
    """markers.yaml → WPILib's AprilTag field layout, which PhotonVision and robot code read. Sizes are not in it.

    Example: ledpi map export markers.yaml layout.json --field 12 8
    """
    from ledpi.calibrate.files import write_keeping_old
    from ledpi.map_wpilib import layout_text
    from ledpi.map_yaml import load_map

    panels = load_map(markers)
    kept = write_keeping_old(out, layout_text(panels, field))
    typer.echo(f"{out} written, {len(panels)} panels" + (f"; the older one is kept as {kept}" if kept else ""))
