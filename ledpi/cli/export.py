"""`ledpi export`: a recording as a bag."""

from __future__ import annotations

from pathlib import Path

import typer

from ledpi.cli import app
from ledpi.cli.progress import progress


@app.command()
def export(
    take: Path = typer.Argument(metavar="TAKE", help="A recording."),
    out: Path = typer.Argument(metavar="OUT.mcap", help="The bag: a new file."),
    config: Path | None = typer.Option(None, "--config", help="Default: ./config.yaml, /etc/ledpi/config.yaml."),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Overrides a key of the configuration."),
) -> None:
    """A recording as an MCAP bag, with what was read and where.

    ROS 2 messages with their types: pictures, lens, poses with covariance, TF, detections. `ros2 bag play`, Foxglove
    and PlotJuggler open it. `ledpi import` makes the same recording of it again.

    Example: ledpi export takes/kitchen kitchen.mcap
    """
    from ledpi.cli.bags_extra import needs_bags
    from ledpi.config.settings import find_config, load_config
    from ledpi.recording.reader import load_recording

    with needs_bags():
        from ledpi.bags.export import export_recording
    settings = load_config(find_config(config), tuple(set_), without_file=("panels.side_m=1",))
    total = len(load_recording(take).frames)
    with progress("exporting", total) as advance:
        for _ in export_recording(settings, take, out, lambda said: typer.echo(said, err=True)):
            advance(1)
    typer.echo(f"{out}: {total} frames, {out.stat().st_size / 1e6:.0f} MB")
