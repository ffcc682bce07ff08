"""`ledpi export` and `ledpi import`: recordings as bags or data logs, and bags or videos as recordings."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import typer

from ledpi.cli import CONFIG, SET, app, progress
from ledpi.config.settings import find_config, load_config
from ledpi.core.errors import InstallationError, counted, install_command
from ledpi.links.bags.replay import Replay

VIDEOS = {".mp4", ".mkv", ".avi", ".mov", ".webm"}


@contextmanager
def needs_bags() -> Iterator[None]:
    """Around an import. Raises InstallationError, which names the extra."""
    try:
        yield
    except ImportError as error:
        raise InstallationError(f"bags need the package {error.name}: {install_command('bags')}") from None


@app.command()
def export(
    take: Path = typer.Argument(metavar="TAKE", help="A recording."),
    out: Path = typer.Argument(metavar="OUT", help="The bag (.mcap) or log (.wpilog): a new file."),
    wpilog: bool = typer.Option(False, "--wpilog", help="Not needed if OUT ends in .wpilog."),
    config: Path | None = CONFIG,
    set_: list[str] = SET,
) -> None:
    """A recording as an MCAP bag, with what was read and where.

    The bag holds ROS 2 messages with their types: pictures, lens, poses with covariance, TF, detections. `ros2 bag
    play`, Foxglove and PlotJuggler open it. `ledpi import` turns it back into the same recording. An OUT that ends in
    .wpilog is WPILib's data log, for AdvantageScope: poses alone, as the NetworkTables bridge would have published.

    Example: ledpi export takes/kitchen kitchen.mcap
    """
    if wpilog or out.suffix == ".wpilog":
        from ledpi.links.bags.wpilog import export_wpilog as exported
    else:
        with needs_bags():
            from ledpi.links.bags.convert import export_bag as exported
    settings = load_config(find_config(config), tuple(set_), without_file=("panels.side_m=1",))
    replay = Replay(settings, take)
    total = len(replay.recording.frames)
    with progress("exporting", total) as advance:
        for _ in exported(replay, out, lambda said: typer.echo(said, err=True)):
            advance(1)
    typer.echo(f"{out}: {total} frames, {out.stat().st_size / 1e6:.1f} MB")


@app.command("import")
def import_(
    path: Path = typer.Argument(metavar="BAG", help="An .mcap file, a ROS bag, or a video."),
    out: Path = typer.Argument(metavar="OUT", help="Folder for the recording: new, or empty."),
    topic: str | None = typer.Option(None, "--topic", help="Topic of the pictures, if the bag has several."),
    config: Path | None = CONFIG,
    set_: list[str] = SET,
) -> None:
    """A bag or a video as a recording, for `ledpi decode`.

    A bag from `ledpi export` or `ledpi record OUT.mcap` becomes the recording that it was. Of other bags the
    pictures' luma is taken; row time, exposure, tone and panels then come from the configuration. Video compression
    removes much of the bands.

    Example: ledpi import kitchen.mcap takes/kitchen
    """
    with needs_bags():
        from ledpi.links.bags.convert import import_bag, import_video

    def warn(said: str) -> None:
        typer.echo(said, err=True)

    settings = load_config(find_config(config), tuple(set_), without_file=("panels.side_m=0.16",))
    is_video = path.suffix.lower() in VIDEOS
    frames = import_video(settings, path, out, warn) if is_video else import_bag(settings, path, out, topic, warn)
    count = 0
    for count in frames:  # noqa: B007, the last one is told
        pass
    typer.echo(f"{out}: {counted(count, 'frame')}")
