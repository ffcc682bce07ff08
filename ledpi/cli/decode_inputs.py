"""Inputs of `ledpi decode`, and where it draws: sorted out and checked before the first line is printed."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from ledpi.camera.recording.reader import Recording, find_recordings
from ledpi.camera.recording.still import SUFFIXES
from ledpi.cli.pictures import check_apart
from ledpi.config.camera_yaml import lens_of
from ledpi.config.settings import Config, check_method
from ledpi.core.errors import RecordingError


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
