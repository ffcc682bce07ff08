"""`ledpi decode`: recordings or pictures → one JSON object a frame; all are checked before one is printed."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer

from ledpi.camera.recorded import load_recording_with
from ledpi.camera.recording.picture import SUFFIXES, read_still
from ledpi.camera.recording.reader import Recording, find_recordings
from ledpi.cli import CONFIG, METHOD, SET, app, progress
from ledpi.cli.pictures import Still, check_apart, says_all, still_of, write_drawn
from ledpi.config.camera_yaml import lens_of
from ledpi.config.settings import Config, check_method, find_config, load_config
from ledpi.core.errors import ConfigError, RecordingError, raising
from ledpi.core.records import Decoded, Frame, Intrinsics, Rejected
from ledpi.core.shutter import row_time_note
from ledpi.core.wording import one_line
from ledpi.decode.identify.frequency_search import off_frequency_note
from ledpi.pipeline.output import decoded_as_json, state_as_json
from ledpi.pipeline.pipeline import Pipeline, load_robot, pipeline_of
from ledpi.state.estimator import State
from ledpi.wire.diary import Replay, read_diary
from ledpi.wire.keeper import Keeper
from ledpi.workshop.snapshot.sources import take
from ledpi.workshop.snapshot.steps import draw_steps


def sort_out(paths: list[Path]) -> tuple[list[tuple[str, Path]], list[Path]]:
    """(name, folder) of every recording, and the picture files, in the order given."""
    recordings: list[tuple[str, Path]] = []
    pictures: list[Path] = []
    for path in paths:
        if path.is_dir():
            found = find_recordings(path)
            if not found:
                raise RecordingError(
                    f"{path}: holds no recording (no recording.yaml in it or below); pictures are given one by one, as "
                    "in DIR/*.png"
                )
            recordings += [(str(f.relative_to(path)) if f != path else path.resolve().name, f) for f in found]
        elif path.suffix.lower() in SUFFIXES and path.is_file():
            pictures.append(path)
        elif path.is_file():
            raise RecordingError(f"{path}: is no picture ({', '.join(sorted(SUFFIXES))}) and no folder")
        elif path.exists():
            raise RecordingError(f"{path}: is a pipe, a device or the like; must be a picture or a folder")
        else:
            raise RecordingError(f"{path}: no such file or folder")
    return recordings, pictures


def distinct(recordings: list[tuple[str, Path]]) -> list[tuple[str, Path]]:
    """Recordings that share a name are called by their paths instead, as these were given."""
    sharing = Counter(name for name, _ in set(recordings))
    return [(name if sharing[name] == 1 else str(folder), folder) for name, folder in recordings]


def check_inputs(loaded: list[tuple[str, Recording]], settings: Config, *, as_live: bool) -> None:
    """Raises LedpiError where what was asked for cannot be had of all recordings."""
    for _, recording in loaded:
        shown = settings.panels.override_with(recording.panel_values)
        check_method(settings.decode.method, shown, f"{recording.folder}: decode.method")
        if as_live and all(entry.decoded is None for entry in recording.frames):
            raise RecordingError(f"{recording.folder}: --as-live: does not say which frames were decoded live")
        lens_of(recording.camera, settings.camera.intrinsics)


def check_names_differ(names: list[str]) -> None:
    """Each recording's steps are drawn into a folder of its name."""
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RecordingError(f"--steps: two recordings are called {twice}, and would be drawn over each other")


def steps_folders(steps: Path | None, loaded: list[tuple[str, Recording]], pictures: list[Path]) -> list[Path | None]:
    """Returns where each recording's steps are drawn: not over its own pictures, nor over another one's."""
    if steps is None:
        return [None] * len(loaded)
    folders = [steps / name if len(loaded) + bool(pictures) > 1 else steps for name, _ in loaded]
    kept = [*pictures, *(entry.picture for _, recording in loaded for entry in recording.frames)]
    for folder in (steps, *folders):
        check_apart(folder, kept, "--steps")
    return [*folders]


OLD_STATE_FILE = "state.bin"  # of older recordings: what the decoder remembered


@app.command()
def decode(
    paths: list[Path] = typer.Argument(metavar="PATH…", help="Recordings, folders that hold some, or pictures."),
    config: Path | None = CONFIG,
    set_: list[str] = SET,
    single_frame: bool = typer.Option(
        False, "--single-frame", help="Decode each frame by itself, without memory of earlier ones."
    ),
    as_live: bool = typer.Option(False, "--as-live", help="Repeat the live results: same frames, same search budgets."),
    method: str | None = METHOD,
    steps: Path | None = typer.Option(
        None, "--steps", metavar="DIR", help="Also draw how each frame was read, as DIR/NNNNNN.png."
    ),
) -> None:
    """Recordings or pictures → one JSON object a frame.

    Each object is one line on standard output. Recordings, and pictures saved by the live page, bring their own
    camera and panel values. Only --set overrides them, for example after measuring the panel again. Other pictures
    take these values from the configuration. A line's "recording" is the folder's name, or its path below the given
    folder; if two share a name, it is the whole path. A picture that cannot be read is named on standard error; the
    others are decoded, and the exit status is 2. With several recordings, --steps makes a folder for each.

    Example: ledpi decode --single-frame recordings/static | jq .markers
    """
    file = find_config(config)
    overrides = [*set_, *([f"decode.method={method}"] if method is not None else [])]
    # Recordings bring their panel's size; pictures without a configuration are refused below.
    settings = load_config(file, tuple(overrides), without_file=("panels.side_m=1",))
    recordings, pictures = sort_out(paths)
    bare = [path for path in pictures if not says_all(path)]
    if bare and file is None and "panels.side_m" not in settings.from_command_line:
        raise ConfigError(
            f"{bare[0]}: does not say how large its panels are: --set panels.side_m=METRES, or a configuration"
        )
    if steps is not None:
        check_names_differ([name for name, _ in recordings])
    # All of them before a line is printed: half an experiment must not pass for the whole.
    loaded = [
        (name, load_recording_with(settings, folder, as_reported=as_live)) for name, folder in distinct(recordings)
    ]
    check_inputs(loaded, settings, as_live=as_live)
    stills = [(path, still_of(path, settings, overrides)) for path in pictures]
    drawn = steps_folders(steps, loaded, pictures)
    bad = 0
    with progress("decoding", sum(len(recording.frames) for _, recording in loaded) + len(pictures)) as advance:
        for (name, recording), folder in zip(loaded, drawn, strict=True):
            bad += _decode_recording(
                name, recording, settings, folder, stream=not single_frame, as_live=as_live, advance=advance
            )
        bad += _decode_pictures(stills, steps, advance=advance)
    if bad:
        raise typer.Exit(2)


def _decode_recording(
    name: str,
    recording: Recording,
    settings: Config,
    steps: Path | None,
    *,
    stream: bool,
    as_live: bool,
    advance: Callable[[int], None],
) -> int:
    """Prints every frame; returns how many pictures could not be read."""
    camera = recording.camera
    if recording.row_time_ratio != 1.0:
        _note(f"{recording.folder}: {row_time_note(camera.row_time_us, recording.row_time_ratio)}")
    lens = lens_of(camera, settings.camera.intrinsics)
    pipeline = pipeline_of(settings, camera, lens, recording.panel_values, stream=stream)
    replay, state = replay_of(recording, settings) if stream else None, None
    bad = 0
    if as_live and (recording.folder / OLD_STATE_FILE).exists():
        _note(f"{recording.folder}: {OLD_STATE_FILE} is not read; the first second may differ from what was live")
    for entry in recording.frames:
        if as_live and not entry.decoded:
            continue
        if as_live and entry.search_budget is not None:
            pipeline.likelihood.search_budget = entry.search_budget
        frame = recording.read(entry)
        if isinstance(frame, Frame):
            decoded = _decode(frame, name, pipeline, lens, steps)
            if replay is not None:
                told = replay.take(decoded.seq, decoded.markers)
                state = newest_state(told, replay.host_offset_ns) if told else state
            _print(decoded, name, {} if replay is None else {"state": state})
        else:
            _note(frame.message)
            _print(_nothing(entry.seq, entry.row0_readout_ns, frame.rejected), name)
            bad += 1
        advance(1)
    for marker_id, found in pipeline.likelihood.off_frequency.items():
        _note(f"{recording.folder}: {off_frequency_note(marker_id, found)}")
    return bad


def _decode_pictures(stills: list[tuple[Path, Still]], steps: Path | None, *, advance: Callable[[int], None]) -> int:
    """Prints every picture, each on its own: nothing is known of the time between them."""
    bad, used, pipeline = 0, None, None
    for seq, (path, still) in enumerate(stills):
        if pipeline is None or used != still:
            pipeline, used = pipeline_of(still.settings, still.camera, still.lens, stream=False), still
        try:
            frame = read_still(path, still.camera, seq)
        except RecordingError as error:
            _note(str(error))
            _print(_nothing(seq, 0, Rejected(stage="capture", reason="unreadable")), str(path))
            bad += 1
        else:
            _print(_decode(frame, str(path), pipeline, still.lens, steps), str(path))
        advance(1)
    return bad


def replay_of(recording: Recording, settings: Config) -> Replay | None:
    """Repeats the states; None where nothing was recorded of how the robot moved, or there is no map."""
    diary = read_diary(recording.folder)
    if diary is None or settings.map is None:
        return None
    return Replay(Keeper(load_robot(settings), settings.odometry, settings.serial.baud), diary)


def newest_state(told: list[tuple[int, State | Rejected]], offset_ns: int) -> dict[str, Any]:
    """The last of some that were told, on the recording's clock."""
    t_ns, state = told[-1]
    return state_as_json(None if isinstance(state, Rejected) else state, t_ns, offset_ns)


def _decode(frame: Frame, name: str, pipeline: Pipeline, lens: Intrinsics | None, steps: Path | None) -> Decoded:
    """One frame; with a folder `steps`, draws into it how it was decoded."""
    if steps is None:
        return pipeline.decode(frame)
    taken = take(f"{name}, frame {frame.seq}", frame, pipeline, lens)
    with raising(f"--steps {steps}: cannot be made", RecordingError, OSError):
        steps.mkdir(parents=True, exist_ok=True)
    write_drawn(steps / f"{frame.seq:06}.png", draw_steps(taken), "--steps")
    return taken.decoded


def _nothing(seq: int, row0_readout_ns: int, why: Rejected) -> Decoded:
    return Decoded(
        seq=seq, row0_readout_ns=row0_readout_ns, host_offset_ns=0, markers=(), robot=None, rejected=(why,), stage_ms={}
    )


def _print(decoded: Decoded, recording: str, more: dict[str, Any] | None = None) -> None:
    print(json.dumps(decoded_as_json(decoded, recording) | (more or {})), flush=True)


def _note(text: str) -> None:
    print(f"ledpi: {one_line(text)}", file=sys.stderr)
