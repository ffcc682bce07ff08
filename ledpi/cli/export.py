"""`ledpi export`: a recording as a bag, or as a data log."""

from __future__ import annotations

from pathlib import Path

import typer

from ledpi.cli import app
from ledpi.cli.progress import progress


@app.command()
def export(
    take: Path = typer.Argument(metavar="TAKE", help="A recording."),
    out: Path = typer.Argument(metavar="OUT", help="The bag (.mcap) or log (.wpilog): a new file."),
    wpilog: bool = typer.Option(False, "--wpilog", help="WPILib's data log, of poses alone, for AdvantageScope."),
    config: Path | None = typer.Option(None, "--config", help="Default: ./config.yaml, /etc/ledpi/config.yaml."),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Overrides a key of the configuration."),
) -> None:
    """A recording as an MCAP bag, with what was read and where.

    The bag holds ROS 2 messages with their types: pictures, lens, poses with covariance, TF, detections. `ros2 bag
    play`, Foxglove and PlotJuggler open it. `ledpi import` turns it back into the same recording. With --wpilog the
    file is a log of what the NetworkTables bridge would have published.

    Example: ledpi export takes/kitchen kitchen.mcap
    """
    from ledpi.bags.replay import Replay
    from ledpi.cli.bags_extra import needs_bags
    from ledpi.config.settings import find_config, load_config

    if wpilog:
        from ledpi.bags.wpilog import export_wpilog as exported
    else:
        with needs_bags():
            from ledpi.bags.export import export_bag as exported
    settings = load_config(find_config(config), tuple(set_), without_file=("panels.side_m=1",))
    replay = Replay(settings, take)
    total = len(replay.recording.frames)
    with progress("exporting", total) as advance:
        for _ in exported(replay, out, lambda said: typer.echo(said, err=True)):
            advance(1)
    typer.echo(f"{out}: {total} frames, {out.stat().st_size / 1e6:.1f} MB")
