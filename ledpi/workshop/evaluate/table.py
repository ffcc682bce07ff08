"""From tallies to rows: rates with their intervals, medians; rows of a real panel's frames; and results.csv."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from statistics import NormalDist, median
from typing import Any

from ledpi.camera.recording.reader import FrameEntry, Recording
from ledpi.config.panels import PanelSettings
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import ConfigError, RecordingError
from ledpi.core.records import Frame, Intrinsics
from ledpi.workshop.evaluate.scoring import FRAMES_A_TAKE, STREAM_ROWS, Expected, PanelMethod, PanelReader, Tally

PLAIN = "plain"  # the case in which nothing is wrong with the panel
PAPER_ANGLES_AT_M = 0.6

_Z95 = NormalDist().inv_cdf(0.975)


def wilson(successes: float, trials: int) -> tuple[float, float]:
    """Wilson's 95 % score interval of a rate (Wilson, J. Am. Stat. Assoc. 22, 1927).

    With p = successes/trials, n = trials: (p + z²/2n ± z·√(p(1−p)/n + z²/4n²)) / (1 + z²/n). Raises ValueError for
    no trials.
    """
    if trials < 1:
        raise ValueError("a rate needs at least one trial")
    rate, z2 = successes / trials, _Z95 * _Z95
    middle = rate + z2 / (2 * trials)
    half = _Z95 * math.sqrt(rate * (1 - rate) / trials + z2 / (4 * trials * trials))
    low, high = (middle - half) / (1 + z2 / trials), (middle + half) / (1 + z2 / trials)
    return max(0.0, min(rate, low)), min(1.0, max(rate, high))  # both hold the rate, but for rounding


@dataclass(frozen=True, slots=True, kw_only=True)
class TableRow:
    """One method under one condition. Errors are medians, of what was recognised."""

    suite: str
    case: str
    distance_m: float | None
    angle_deg: float | None
    exposure_us: float
    transfer: str
    roll: str  # any, upright, or empty where it is not known
    method: str
    frames: int
    trials: int
    expected: int
    recognised: int
    rate: float | None  # None where nothing was to be recognised
    rate_low: float | None
    rate_high: float | None
    false_ids: int
    corner_px: float | None
    position_percent: float | None
    angle_error_deg: float | None
    decode_ms: float | None
    missed: tuple[tuple[str, int], ...]  # why, how often; the most frequent first
    false: tuple[str, ...]


def table_row(tally: Tally, *, any_roll: bool | None, **condition: Any) -> TableRow:
    """One of the condition: suite, case, distance_m, angle_deg, exposure_us, transfer and method.

    The interval counts trials, not frames: frames of one take share its place, room and noise of the sensor.
    """
    rate = tally.recognised / tally.expected if tally.expected else None
    low, high = wilson(rate * tally.trials, tally.trials) if rate is not None else (None, None)
    counts = {name: getattr(tally, name) for name in ("frames", "trials", "expected", "recognised", "false_ids")}
    return TableRow(
        **condition,
        **counts,
        roll="" if any_roll is None else "any" if any_roll else "upright",
        rate=rate,
        rate_low=low,
        rate_high=high,
        corner_px=_median(tally.corner_px),
        position_percent=_median(tally.position_percent),
        angle_error_deg=_median(tally.angle_deg),
        decode_ms=_median(tally.decode_ms),
        missed=tuple(sorted(tally.missed.items(), key=lambda item: (-item[1], item[0]))),
        false=tuple(tally.false),
    )


def _median(values: Sequence[float]) -> float | None:
    return median(values) if values else None


COLUMNS = tuple(field.name for field in fields(TableRow) if field.name != "false")


def write_csv(path: Path, rows: Iterable[TableRow]) -> None:
    """One line a row; empty where a value does not exist."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows([_as_text(getattr(row, name)) for name in COLUMNS] for row in rows)


def _as_text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, tuple):
        return " ".join(f"{why}:{count}" for why, count in value)
    return str(value)


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

    def readers() -> dict[PanelMethod, PanelReader]:
        return {method: PanelReader(method, info, panels, shown) for method in methods}

    return {
        "unit": f"{recording.folder.absolute()} {marker_id} {distance_m:g} {angle_deg:g}",
        "distance_m": distance_m,
        "angle_deg": angle_deg,
        "exposure_us": camera.exposure_us,
        "transfer": camera.transfer,
        "rows": {row: tally.as_json() for row, tally in _read_all(recording, marker_id, readers, advance).items()},
    }


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
