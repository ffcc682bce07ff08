"""The same table from frames of a real panel: the source paper's experiment on one's own hardware."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from ledpi.camera.recording.reader import FrameEntry, Recording
from ledpi.config.panels import PanelSettings
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import ConfigError, RecordingError
from ledpi.core.records import CameraInfo, Frame, Intrinsics, PanelValues
from ledpi.workshop.evaluate.scoring import FRAMES_A_TAKE, STREAM_ROWS, Expected, PanelMethod, PanelReader, Tally
from ledpi.workshop.evaluate.table import PLAIN, TableRow, table_row

_PLACE = ("distance_m", "angle_deg", "exposure_us", "transfer")


def evaluate_recording(
    recording: Recording,
    *,
    marker_id: int,
    distance_m: float,
    angle_deg: float,
    methods: Sequence[PanelMethod],
    intrinsics: Intrinsics | None,
    panels: PanelSettings,
    advance: Callable[[int], None],
) -> dict[str, Any]:
    """A record, for `rows_of_recordings`, of a recording that shows panel `marker_id` in every frame.

    Streams are cut into takes of 12 frames, each begun anew, as those of the suites are. Corners and poses are judged
    where the recording has truth. Raises RecordingError for a picture that cannot be read, ConfigError for an ID that
    the dictionary does not have, or that is not in the truth.
    """
    words = len(load_dictionary(recording.dictionary).codewords)
    if not 0 <= marker_id < words:
        raise ConfigError(f"--id {marker_id}: {recording.dictionary} has the IDs 0 to {words - 1}")
    in_view = {truth.id for frame in (recording.truth or {}).values() for truth in frame}
    if recording.truth is not None and marker_id not in in_view:
        there = ", ".join(map(str, sorted(in_view))) or "no panel"
        raise ConfigError(f"--id {marker_id}: by its truth.jsonl, {recording.folder} shows {there}")
    camera = recording.camera
    info = replace(camera, intrinsics=camera.intrinsics or intrinsics)
    shown = recording.panel_values
    readers = partial(_readers, methods, info, shown, panels)
    return {
        "unit": f"{recording.folder.absolute()} {marker_id} {distance_m:g} {angle_deg:g}",
        "distance_m": distance_m,
        "angle_deg": angle_deg,
        "exposure_us": camera.exposure_us,
        "transfer": camera.transfer,
        "rows": {row: tally.as_json() for row, tally in _read_all(recording, marker_id, readers, advance).items()},
    }


def _readers(
    methods: Sequence[PanelMethod], camera: CameraInfo, shown: PanelValues, panels: PanelSettings
) -> dict[PanelMethod, PanelReader]:
    return {method: PanelReader(method, camera, panels, shown) for method in methods}


def _read_all(
    recording: Recording,
    marker_id: int,
    readers: Callable[[], dict[PanelMethod, PanelReader]],
    advance: Callable[[int], None],
) -> dict[str, Tally]:
    """By row; each take is read by new `readers`."""
    tallies: dict[str, Tally] = {}
    current = readers()
    for number in range(len(recording.frames)):
        index = number % FRAMES_A_TAKE
        if index == 0:
            current = readers()
        frame = frame_of(recording, recording.frames[number])
        expected = _expected(recording, frame, marker_id)
        for method, reader in current.items():
            read = reader.read(frame)
            for row in STREAM_ROWS if method == "stream" else (method,):
                tally = tallies.setdefault(row, Tally())
                if index in STREAM_ROWS.get(row, range(FRAMES_A_TAKE)):
                    tally.add(read, expected, f"{recording.folder.name}, frame {frame.seq}")
                    tally.trials += row != "stream_all" or index == 0
        advance(1)
    return tallies


def frame_of(recording: Recording, entry: FrameEntry) -> Frame:
    """Reads a frame. Raises RecordingError for a picture that cannot be read."""
    frame = recording.read(entry)
    if not isinstance(frame, Frame):
        raise RecordingError(frame.message)
    return frame


def _expected(recording: Recording, frame: Frame, marker_id: int) -> list[Expected]:
    if recording.truth is None:
        return [Expected(id=marker_id)]
    return [Expected.from_truth(truth) for truth in recording.truth.get(frame.seq, ())]


def rows_of_recordings(records: Iterable[dict[str, Any]]) -> list[TableRow]:
    """The tables' rows, in order of distance and angle; recordings of the same place are put together."""
    places: dict[tuple[Any, ...], list[Tally]] = {}
    for record in sorted(records, key=lambda record: (record["distance_m"], record["angle_deg"], record["unit"])):
        place = tuple(record[key] for key in _PLACE)
        for row, values in record["rows"].items():
            places.setdefault((*place, row), []).append(Tally.from_json(values))
    return [
        table_row(
            Tally.sum_of(tallies),
            suite="recording",
            case=PLAIN,
            any_roll=None,
            method=row,
            **dict(zip(_PLACE, place, strict=True)),
        )
        for (*place, row), tallies in places.items()
    ]
