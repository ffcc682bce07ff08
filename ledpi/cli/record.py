"""`ledpi record`: the camera to a recording."""

from __future__ import annotations

import signal
import threading
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import typer

from ledpi.camera.base import Camera
from ledpi.camera.factory import open_camera
from ledpi.cli import CONFIG, SET, app, progress
from ledpi.cli.bags import needs_bags
from ledpi.config.camera_yaml import lens_of
from ledpi.config.settings import Config, find_config, load_config
from ledpi.core.errors import counted
from ledpi.core.records import CameraInfo
from ledpi.daemon.recorder import FrameWriter, Recorded, Recorder
from ledpi.daemon.takes import TakeWriter
from ledpi.pipeline.pipeline import Pipeline, pipeline_of

TICK_S = 0.1


@app.command()
def record(
    out: Path = typer.Argument(metavar="OUT", help="Folder for the recording, or a bag OUT.mcap: new."),
    seconds: float = typer.Option(10.0, "--seconds", min=0.1, max=86400, help="Stop after this time."),
    frames: int | None = typer.Option(
        None, "--frames", min=1, help="Stop after this many frames, if that comes first."
    ),
    max_mb: float = typer.Option(2000.0, "--max-mb", min=1.0, help="Stop before the pictures take more than this."),
    config: Path | None = CONFIG,
    set_: list[str] = SET,
) -> None:
    """Record the camera at its full rate, and decode live meanwhile.

    The recording holds all that `ledpi decode` needs. OUT.mcap is a bag of ROS 2 messages, which `ledpi import` makes
    a recording of. What was decoded live is in OUT/live.jsonl; `ledpi decode --as-live OUT` gives the same again.
    Ctrl-C ends it early. What was recorded until then is complete, even if the disk fills up. A frame takes some 170
    kB.

    Example: ledpi record takes/kitchen --seconds 30
    """
    file = find_config(config)
    settings = load_config(file, tuple(set_))
    with closing(open_camera(settings, recover=True)) as camera:
        recorder = _recorder(out, settings, camera)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: recorder.stop())
        try:
            _run(recorder, seconds=seconds, frames=frames, max_bytes=max_mb * 1e6)
        finally:
            if recorder.done != Recorded():  # else the folder was refused, and nothing was begun
                typer.echo(f"{out}: {summary(recorder.done)}")


def _recorder(out: Path, settings: Config, camera: Camera) -> Recorder:
    lens = lens_of(camera.info, settings.camera.intrinsics)
    pipeline = pipeline_of(settings, camera.info, lens, camera.panel)
    return Recorder(camera, _writer(out, settings, replace(camera.info, intrinsics=lens), pipeline), pipeline)


def _writer(out: Path, settings: Config, camera: CameraInfo, pipeline: Pipeline) -> FrameWriter:
    """Returns that of a folder, or of a bag."""
    dictionary, panel = pipeline.panels.dictionary, pipeline.panels.spec()
    note = f"recorded from {settings.camera.source}"
    if out.suffix == ".mcap":
        with needs_bags():
            from ledpi.links.bags.bag_writer import BagWriter
        return BagWriter(out, camera=camera, dictionary=dictionary, panel=panel, note=note)
    return TakeWriter(out, camera=camera, dictionary=dictionary, panel=panel, note=note)


def _run(recorder: Recorder, *, seconds: float, frames: int | None, max_bytes: float) -> None:
    """Ends it in time, or before it takes too much room; a bar shows how far it is."""

    def watch() -> None:
        with progress("recording", round(seconds / TICK_S)) as advance:
            for _ in range(round(seconds / TICK_S)):
                if ended.wait(TICK_S) or recorder.done.picture_bytes >= max_bytes:
                    break
                advance(1)
        recorder.stop()

    ended = threading.Event()
    watching = threading.Thread(target=watch)
    watching.start()
    try:
        recorder.run(frames)
    finally:
        ended.set()
        watching.join()


def summary(done: Recorded) -> str:
    """As in `600 frames, 101 MB; 312 decoded live; none lost`."""
    lost = {
        "dropped, as encoders or disk were too slow": done.dropped,
        "missed, as this machine was busy": done.missed,
        "unfit": done.unfit,
    }
    said = ", ".join(f"{count} {why}" for why, count in lost.items() if count) or "none lost"
    if done.lost:
        said += f"; the camera was lost and opened again {counted(done.lost, 'time')}"
    return f"{counted(done.written, 'frame')}, {done.picture_bytes / 1e6:.0f} MB; {done.decoded} decoded live; {said}"
