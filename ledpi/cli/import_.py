"""`ledpi import`: a bag or a video as a recording."""

from __future__ import annotations

from pathlib import Path

import typer

from ledpi.cli import app
from ledpi.core.wording import counted

VIDEOS = {".mp4", ".mkv", ".avi", ".mov", ".webm"}


@app.command("import")
def import_(
    path: Path = typer.Argument(metavar="BAG", help="An .mcap file, a ROS bag, or a video."),
    out: Path = typer.Argument(metavar="OUT", help="Folder for the recording: new, or empty."),
    topic: str | None = typer.Option(None, "--topic", help="Topic of the pictures, if the bag has several."),
    config: Path | None = typer.Option(None, "--config", help="Default: ./config.yaml, /etc/ledpi/config.yaml."),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Overrides a key of the configuration."),
) -> None:
    """A bag or a video as a recording, for `ledpi decode`.

    A bag from `ledpi export` or `ledpi record OUT.mcap` becomes the recording that it was. Of other bags the
    pictures' luma is taken; row time, exposure, tone and panels then come from the configuration. Video compression
    removes much of the bands.

    Example: ledpi import kitchen.mcap takes/kitchen
    """
    from ledpi.cli.bags_extra import needs_bags
    from ledpi.config.settings import find_config, load_config

    with needs_bags():
        from ledpi.bags.importing import import_bag, import_video

    def warn(said: str) -> None:
        typer.echo(said, err=True)

    settings = load_config(find_config(config), tuple(set_), without_file=("panels.side_m=0.16",))
    is_video = path.suffix.lower() in VIDEOS
    frames = import_video(settings, path, out, warn) if is_video else import_bag(settings, path, out, topic, warn)
    count = 0
    for count in frames:  # noqa: B007, the last one is told
        pass
    typer.echo(f"{out}: {counted(count, 'frame')}")
