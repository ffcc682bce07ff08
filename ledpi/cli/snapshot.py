"""`ledpi snapshot`: one annotated picture of one frame."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import typer

from ledpi.camera.factory import open_camera
from ledpi.camera.recorded import RecordingCamera, load_recording_with
from ledpi.camera.recording.picture import read_still
from ledpi.cli import CONFIG, METHOD, SET, app, progress
from ledpi.cli.pictures import check_apart, says_all, still_of, write_drawn
from ledpi.cli.plan import draw_plan
from ledpi.config.camera_yaml import lens_of
from ledpi.config.settings import Config, find_config, load_config
from ledpi.core.errors import CameraError, ConfigError, RecordingError
from ledpi.core.records import Decoded, Frame, MarkerPose
from ledpi.daemon.tap.frames import settings_of
from ledpi.pipeline.diagnosis.why_not import RUN_FRAMES, Why
from ledpi.pipeline.pipeline import pipeline_of
from ledpi.workshop.snapshot.page import draw
from ledpi.workshop.snapshot.sources import Looking, Source, connected, explain, showing_a_panel, take
from ledpi.workshop.snapshot.steps import draw_steps

FORMATS = (".png", ".jpg")


@app.command()
def snapshot(
    path: Path | None = typer.Argument(
        None,
        metavar="PATH",
        help="A recording or a picture. Default: a frame of the running daemon, else of the camera.",
    ),
    config: Path | None = CONFIG,
    set_: list[str] = SET,
    frame: int | None = typer.Option(
        None, "--frame", min=0, metavar="SEQ", help="Frame of a recording; with a camera, the first frame to use."
    ),
    out: Path = typer.Option(Path("snapshot.png"), "--out", help="Picture to write, .png or .jpg."),
    method: str | None = METHOD,
    steps: bool = typer.Option(False, "--steps", help="Draw the steps of the method instead."),
    map_: bool = typer.Option(False, "--map", help="Draw the map from above instead, and where the robot is."),
) -> None:
    """One frame as an annotated picture.

    It shows the amplified bands, the cells, the poses, and why a panel is not read. The frame is decoded by itself,
    without memory of earlier ones. Without --frame, it is the camera's first in half a second that shows a panel.
    Standard output says what was read, and where the frame came from. For each panel that was not read, it says what
    is wrong and what helps. If a daemon runs here, its frame and its settings are used. --frame, another --config, or
    a --set of the section `camera` uses the camera itself. --map is of the daemon or a recording; it shows the state,
    if the controller's motion is known, else the fix.

    Example: ledpi snapshot recordings/drive --frame 42 --out frame42.png
    """
    if out.suffix.lower() not in FORMATS:
        raise ConfigError(f"--out {out}: must end in {' or '.join(FORMATS)}")
    if path is not None and not path.exists():
        raise RecordingError(f"{path}: no such file or folder")
    if path is not None and out.exists() and out.samefile(path):
        raise ConfigError(f"--out {out}: is the picture that is read; must be another file")
    overrides = [*set_, *([] if method is None else [f"decode.method={method}"])]
    if map_:
        typer.echo(f"{out}: {draw_plan(path, config, overrides, frame, out)}")
        return
    asks_for_camera = frame is not None or any(item.startswith("camera") for item in set_)
    daemon = _of_daemon(config, overrides) if path is None and not asks_for_camera else None
    source, settings = daemon or _open(path, config, overrides, frame)
    check_apart(out.parent, source.pictures, "--out")
    pipeline = pipeline_of(settings, source.camera, source.intrinsics, source.panel, stream=False)
    taken = take(source.title, source.frame, pipeline, source.intrinsics)
    why = explain(taken, source.camera.rows_from, source.run)
    write_drawn(out, draw_steps(taken) if steps else draw(taken, why), "--out")
    typer.echo(f"{out}: {source.title}: {summary(taken.decoded)}")
    for says, helps in reasons(why):
        typer.echo(f"  {says}\n    → {helps}" if helps else f"  {says}")


def _open(path: Path | None, config: Path | None, overrides: list[str], seq: int | None) -> tuple[Source, Config]:
    """Opens what is not the daemon's, with the settings of the configuration."""
    brings_panel = path is not None and (path.is_dir() or says_all(path))
    own_size = ("panels.side_m=1",) if brings_panel else ()
    settings = load_config(find_config(config), tuple(overrides), without_file=own_size)
    if path is None:
        return _from_camera(settings, seq), settings
    if path.is_dir():
        return _from_recording(path, settings, seq), settings
    if seq:
        raise ConfigError(f"--frame {seq}: {path} is a picture, not a recording; it has no frame but 0")
    still = still_of(path, settings, overrides)
    return Source(path.name, read_still(path, still.camera), still.camera, None, still.lens), still.settings


def _of_daemon(config: Path | None, overrides: list[str]) -> tuple[Source, Config] | None:
    """A frame of the daemon that runs here, with its settings; None where none does."""
    tap = connected(config)
    if tap is None:
        return None
    with tap:
        settings = settings_of(tap.hello, overrides)
        return showing_a_panel(tap, settings), settings


def _from_camera(settings: Config, seq: int | None) -> Source:
    """The first usable frame from `seq` on, else the first of half a second that shows a panel."""
    name = settings.camera.source
    with closing(
        open_camera(settings, paced=name.partition(":")[0] not in ("simulated", "recording"), first=seq or 0)
    ) as camera:
        lens = lens_of(camera.info, settings.camera.intrinsics)
        looking = Looking(camera, settings, lens)
        looking.expose()
        frame = looking.showing_a_panel() if seq is None else _numbered(looking.frames(), seq)
        if frame is None:
            raise CameraError(f"camera.source: {name} ended before frame {seq or 0}")
        title = f"{Path(name).name}, frame {frame.seq}"
        return Source(title, frame, camera.info, camera.panel, lens, run=tuple(looking.run))


def _numbered(frames: Iterator[Frame], seq: int) -> Frame | None:
    with progress("waiting for the frame", seq + 1) as advance:
        for frame in frames:
            advance(1)
            if frame.seq >= seq:
                return frame
    return None


def _from_recording(folder: Path, settings: Config, seq: int | None) -> Source:
    recording = load_recording_with(settings, folder)
    entries = recording.frames
    at = next((index for index, entry in enumerate(entries) if seq is None or entry.seq == seq), None)
    if at is None:
        raise RecordingError(f"{folder}: has no frame {seq}; has {len(entries)}, {entries[0].seq} to {entries[-1].seq}")
    run: list[Frame] = []
    for entry in entries[max(0, at + 1 - RUN_FRAMES) :][:RUN_FRAMES]:
        frame = recording.read(entry)
        if isinstance(frame, Frame):
            run.append(frame)
        elif entry is entries[at]:
            raise RecordingError(frame.message)
    frame = next(one for one in run if one.seq == entries[at].seq)
    camera = RecordingCamera(recording, paced=False)
    title = f"{folder.resolve().name}, frame {frame.seq}"
    lens, pictures = lens_of(camera.info, settings.camera.intrinsics), tuple(entry.picture for entry in entries)
    return Source(title, frame, camera.info, camera.panel, lens, pictures, tuple(run))


def reasons(why: Why) -> list[tuple[str, str]]:
    """Lists what is not read, why, and what helps."""
    told = [(one.line, one.helps) for one in why.told]
    return told + [(note.says, note.helps) for note in why.notes]


def summary(decoded: Decoded) -> str:
    """One line on a frame, as in `ID 7 at +0.100 -0.200 1.500 m, margin 14; dropped: identify.no_bands 1`."""
    counts = Counter(rejected.key for rejected in decoded.rejected)
    dropped = ", ".join(f"{key} {count}" for key, count in counts.most_common())
    parts = [_marker_text(marker) for marker in decoded.markers] or ["no panel read"]
    return "; ".join(parts + ([f"dropped: {dropped}"] if dropped else []))


def _marker_text(marker: MarkerPose) -> str:
    detection, where = marker.detection, "without a pose"
    if marker.solution is not None:
        x, y, z = marker.solution.camera_from_marker.position_m
        where = f"at {x:+.3f} {y:+.3f} {z:.3f} m"
    return f"ID {detection.id} {where}, margin {detection.margin:.0f}"
