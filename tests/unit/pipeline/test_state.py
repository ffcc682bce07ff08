"""What a pipeline remembers, written and read again: it goes on to the last bit, and nothing hostile comes in."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ledpi.core.errors import RecordingError
from ledpi.pipeline import state_file
from ledpi.pipeline.state import size_of
from ledpi.pipeline.state_file import MAX_BYTES, STATE_FILE, as_bytes, resume_from
from tests.builders import ROOT
from tests.builders.rewind import EVERY, Stream, exactly, robot_in, stream

COUNT = 40  # frames: both panels are read, and followed, from the 12th or so on
LATE = 2 * EVERY


@pytest.fixture(scope="module")
def drive() -> Stream:
    return stream(COUNT)


def resumed(drive: Stream, index: int, folder: Path) -> list[tuple[Any, ...]]:
    """What another pipeline makes of the frames from `index` on, with the state that was there."""
    (folder / STATE_FILE).write_bytes(as_bytes(drive.states[index]))
    pipeline = drive.pipeline()
    assert resume_from(folder, pipeline)
    return [exactly(pipeline.decode(frame)) for frame in drive.frames[index:]]


@pytest.mark.parametrize("index", [0, EVERY, LATE])
def test_a_pipeline_goes_on_to_the_last_bit(drive: Stream, index: int, tmp_path: Path) -> None:
    """IDs, margins, corners, poses, deviations and reasons, from the first frame after the state."""
    assert resumed(drive, index, tmp_path) == [exactly(decoded) for decoded in drive.live[index:]]


def test_without_its_state_it_would_not(drive: Stream) -> None:
    """The test above can fail: frames that are decoded from nothing give something else."""
    pipeline = drive.pipeline()
    again = [exactly(pipeline.decode(frame)) for frame in drive.frames[LATE:]]
    assert again != [exactly(decoded) for decoded in drive.live[LATE:]]


@pytest.mark.parametrize("setting", ["panels.search_frequencies=true", "panels.overrides={7: {black_hz: 1300}}"])
def test_so_does_one_that_looks_for_other_things(setting: str, tmp_path: Path) -> None:
    """Frequencies that are searched, or two kinds of panels at a time."""
    other = stream(LATE + 5, setting)
    assert resumed(other, LATE, tmp_path) == [exactly(decoded) for decoded in other.live[LATE:]]


def test_the_last_fix_goes_along(drive: Stream, tmp_path: Path) -> None:
    """A robot with a map: what its last fix was is not forgotten."""
    robot = robot_in(drive.live[-1])
    driven = stream(LATE + 5, robot=robot)
    assert driven.states[LATE].placed.fix_history.last is not None
    assert resumed(driven, LATE, tmp_path) == [exactly(decoded) for decoded in driven.live[LATE:]]


def test_a_recording_without_a_state_has_none(drive: Stream, tmp_path: Path) -> None:
    """`ledpi record` begins with a pipeline that has seen nothing, and so does its replay."""
    assert not resume_from(tmp_path, drive.pipeline())


def test_its_size_is_known_beforehand(drive: Stream) -> None:
    """No less than it takes, and not several times as much: rewind's memory is counted by it."""
    state = drive.states[COUNT // EVERY * EVERY]
    assert len(as_bytes(state)) <= size_of(state) <= 4 * len(as_bytes(state))


def test_nothing_in_a_state_changes(drive: Stream) -> None:
    """It is taken without copying: frames that are decoded later leave it as it was."""
    pipeline = drive.pipeline()
    for frame in drive.frames[:LATE]:
        pipeline.decode(frame)
    state = pipeline.state()
    before = as_bytes(state)
    for frame in drive.frames[LATE:]:
        pipeline.decode(frame)
    assert as_bytes(state) == before


# ---- Hostile files


def refused(drive: Stream, folder: Path, content: bytes) -> str:
    """Why the file is refused, in one line that names it."""
    (folder / STATE_FILE).write_bytes(content)
    with pytest.raises(RecordingError) as caught:
        resume_from(folder, drive.pipeline())
    message = str(caught.value)
    assert message.startswith(f"{folder / STATE_FILE}: ")
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "begins with no line of JSON"),
        (b"\x80\x04\x95", "begins with no line of JSON"),  # as a pickle begins
        (b"[" * 100_000, "begins with no line of JSON"),
        (b"[]\n", "ledpi_state: must be 1"),
        (b'{"ledpi_state": 2, "bytes": 0}\n', "ledpi_state: must be 1, not 2"),
        (b'{"ledpi_state": 1}\n', "bytes: is missing"),
        (b'{"ledpi_state": 1, "bytes": 8}\n1234', "has 4 bytes of arrays; must have the 8"),
        (b'{"ledpi_state": 1, "bytes": 0}\n', "state: is missing"),
        (b'{"ledpi_state": 1, "bytes": 0, "state": 3}\n', "must be a mapping, not 3"),
        (b'{"ledpi_state": 1, "bytes": 0, "state": {"samples": 7}}\n', "samples: must be a list"),
    ],
)
def test_what_is_no_state_is_refused(drive: Stream, tmp_path: Path, content: bytes, why: str) -> None:
    """One line: the file, what is wrong, what would be right."""
    assert why in refused(drive, tmp_path, content)


def test_a_file_of_any_size_is_not_read(drive: Stream, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """More than a state ever takes is no state."""
    monkeypatch.setattr(state_file, "MAX_BYTES", 1000)
    assert "must be at most 1,000 bytes" in refused(drive, tmp_path, as_bytes(drive.states[LATE]))
    assert MAX_BYTES < 1e8


def changed(drive: Stream, change: Callable[[dict[str, Any]], None]) -> bytes:
    """A real state, changed in one place."""
    head, _, room = as_bytes(drive.states[LATE]).partition(b"\n")
    values = json.loads(head)
    change(values["state"])
    return json.dumps(values).encode() + b"\n" + room


def _followed(state: dict[str, Any]) -> dict[str, Any]:
    """The history of a track that was read."""
    return next(history for _, history in state["followed"]["tracks"] if history["last"] is not None)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda s: s["samples"][0].update(lattice=10**6), "samples.0.lattice: must be a whole number from 3 to 12"),
        (lambda s: s["samples"][0]["light"].__setitem__(0, 10**9), "samples.0.light: must be within the"),
        (lambda s: s["samples"][0]["light"].__setitem__(1, 10**9), "samples.0.light: must be [start, 16,"),
        (lambda s: s["samples"][0]["light"].__setitem__(0, 4), "samples.0.light: must be within the"),
        (lambda s: s["samples"][0]["light"].__setitem__(0, -8), "samples.0.light.0: must be a whole number from 0"),
        (lambda s: s["frames"][0].update(row_time_us=0), "frames.0.row_time_us: must be a number from 0.1"),
        (lambda s: s["frames"][0].update(transfer="os.system"), "frames.0.transfer: must be linear or srgb"),
        (lambda s: _followed(s).update(memories=[]), "memories: must be a list of 1 to 1"),
        (lambda s: _followed(s)["last"].update(group=3), "last.group: must be a whole number from 0 to 0"),
        (lambda s: _followed(s)["last"]["reading"].update(margin=float("nan")), "margin: must be a number"),
        (lambda s: _followed(s)["last"]["prediction"]["basis"].__setitem__(1, 10**6), "basis: must be [start, 9,"),
        (lambda s: _followed(s)["memories"][0].update(last=[0, 10**6]), "last.1: must be a whole number from 0"),
        (lambda s: _followed(s)["memories"][0].update(last=None), "last: must be null where there were no frames"),
        (lambda s: _followed(s)["memories"][0]["spec"].update(black_hz=9000.0), "must be decoded with the config"),
        (lambda s: _followed(s)["memories"][0]["spec"].update(duty=2), "duty: must be a number from 0.001"),
        (lambda s: s["agenda"].update(middles=s["agenda"]["turns"]), "agenda.middles: must be a list"),
        (lambda s: s["clock"].update(ratio=1e9), "clock.ratio: must be a number from 0.5 to 2"),
        (lambda s: s["clock"].update(ratio=True), "clock.ratio: must be a number"),
        (lambda s: s["placed"].update(hypotheses=[[7]]), "placed.hypotheses.0: must be a list of 2 to 2"),
        (lambda s: s.pop("placed"), "placed: is missing"),
        (lambda s: s["followed"].update(now_ns=2**70), "followed.now_ns: must be a whole number"),
        (lambda s: s["followed"].update(tracks=[[{}, {}]] * 5000), "followed.tracks: must be a list of 0 to 4096"),
    ],
)
def test_a_wrong_value_is_named(
    drive: Stream, tmp_path: Path, change: Callable[[dict[str, Any]], None], why: str
) -> None:
    """Where it is, what would be right. Of arrays the shape counts, as C would read beyond a smaller one."""
    assert why in refused(drive, tmp_path, changed(drive, change))


def test_numbers_that_are_none_are_refused(drive: Stream, tmp_path: Path) -> None:
    """Arrays hold finite numbers only."""
    head, _, room = as_bytes(drive.states[LATE]).partition(b"\n")
    assert "an array" in refused(drive, tmp_path, head + b"\n" + b"\xff" * len(room))


def test_a_state_of_other_panels_is_refused(drive: Stream, tmp_path: Path) -> None:
    """Decoded with another configuration than it was taken with; the message says so."""
    (tmp_path / STATE_FILE).write_bytes(as_bytes(drive.states[LATE]))
    other = Stream(stream(0, "panels.black_hz=300", "panels.white_hz=700").config, drive.camera, None, [], [], {})
    with pytest.raises(RecordingError, match="must be decoded with the configuration that it was taken with"):
        resume_from(tmp_path, other.pipeline())


FUZZ = """
import sys, pickle
from pathlib import Path
from ledpi.core.errors import RecordingError
from ledpi.pipeline.state_file import resume_from
stream = pickle.loads(Path(sys.argv[1]).read_bytes())
read = refused = failed = 0
for folder in sys.argv[2:]:
    pipeline = stream.pipeline()
    try:
        resume_from(Path(folder), pipeline)
    except RecordingError:
        refused += 1
        continue
    read += 1
    try:
        for frame in stream.frames:
            pipeline.decode(frame)
    except (ArithmeticError, ValueError, AssertionError, LookupError, TypeError, MemoryError):
        failed += 1  # as `ledpi decode` would tell
print(read, refused, failed)
"""


def test_no_state_brings_the_decoder_down(drive: Stream, tmp_path: Path) -> None:
    """Real states with numbers changed at random, in a process of their own, which would not survive a wild read."""
    import pickle

    chance = random.Random(5)
    folders = []
    for number in range(60):
        content = bytearray(as_bytes(drive.states[LATE]))
        line_end = content.index(b"\n")
        for _ in range(chance.choice([1, 3, 30])):
            if chance.random() < 0.5:
                at = chance.randrange(line_end)
                content[at] = ord(chance.choice("0123456789-.e")) if chr(content[at]).isdigit() else content[at]
            else:
                at = line_end + 1 + 8 * chance.randrange((len(content) - line_end - 9) // 8)
                value = chance.choice([0.0, -1.0, 1e6, -1e6, 1e25, 1e-300, chance.uniform(-100, 100)])
                content[at : at + 8] = np.float64(value).tobytes()
        folders.append(tmp_path / str(number))
        folders[-1].mkdir()
        (folders[-1] / STATE_FILE).write_bytes(content)
    few = Stream(drive.config, drive.camera, None, drive.frames[LATE : LATE + 2], [], {})
    (tmp_path / "stream").write_bytes(pickle.dumps(few))
    command = [sys.executable, "-c", FUZZ, str(tmp_path / "stream"), *map(str, folders)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr[-500:]
    read, refusals, _ = map(int, done.stdout.split())
    assert read >= 10
    assert refusals >= 10
