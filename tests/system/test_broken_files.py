"""Configurations, maps and recordings that were damaged at random: each is read, or refused in one line."""

from __future__ import annotations

import copy
import json
import logging
import random
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ledpi.camera.recording.reader import load_recording
from ledpi.config.map_yaml import load_map
from ledpi.config.settings import load_config
from ledpi.core.errors import LedpiError
from tests.builders.command import complaint as one_complaint
from tests.builders.command import in_process
from tests.builders.daemon import ROOT, write_recording

WORDS = [b"null", b"[]", b"{}", b"-1", b"1e999", b".nan", b"yes", b"2001-99-99", b"!!timestamp x", b": ", b"&a *a"]


def damaged(text: bytes, rng: random.Random) -> bytes:
    """One to three faults: a value exchanged, a line lost or doubled, bytes flipped, the end cut off."""
    content = bytearray(text)
    for _ in range(rng.randint(1, 3)):
        lines = content.split(b"\n")
        at = rng.randrange(len(lines))
        match rng.randrange(5):
            case 0:
                head, colon, _ = lines[at].partition(b":")
                lines[at] = head + colon + b" " + rng.choice(WORDS)
            case 1:
                del lines[at]
            case 2:
                lines.insert(at, lines[rng.randrange(len(lines))])
            case 3:
                lines[at] = bytes(b ^ (rng.random() < 0.1) * rng.getrandbits(8) for b in lines[at])
            case _:
                lines[at] = lines[at][: rng.randrange(len(lines[at]) + 1)]
        content = bytearray(b"\n".join(lines))
    return bytes(content)


def is_refused(read: Callable[[Path], object], place: Path) -> bool:
    """Tells whether it is not taken; in one line, which names the place. Any other error ends the test."""
    try:
        read(place)
    except LedpiError as error:
        said = str(error)
    else:
        return False
    assert str(place) in said
    assert "\n" not in said
    return True


@pytest.mark.parametrize("seed", range(10))
def test_a_damaged_configuration_is_refused_in_one_line(tmp_path: Path, seed: int) -> None:
    """Twenty of them a seed. What is no ConfigError would be a traceback."""
    rng, file = random.Random(seed), tmp_path / "config.yaml"
    sound = (ROOT / "config.yaml").read_bytes()
    refused = 0
    for _ in range(20):
        file.write_bytes(damaged(sound, rng))
        refused += is_refused(load_config, file)
    assert refused > 0


SCALARS = st.none() | st.booleans() | st.integers() | st.floats() | st.dates() | st.text(max_size=8) | st.just("auto")
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.integers() | st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)
SOUND = yaml.safe_load((ROOT / "config.yaml").read_text(encoding="utf-8"))
MAP = (ROOT / "docs/map.md").read_text(encoding="utf-8").partition("```yaml\n")[2].partition("```")[0]
KEYS = sorted((section, key) for section, keys in SOUND.items() if isinstance(keys, dict) for key in keys)


EIGHTY = settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.mark.slow
@EIGHTY
@given(st.dictionaries(st.sampled_from(KEYS), VALUES, min_size=1, max_size=3))
def test_any_value_is_taken_or_refused_in_one_line(tmp_path: Path, values: dict[tuple[str, str], object]) -> None:
    """Changes one to three keys of the configuration that is shipped: to what YAML can write."""
    changed = {section: dict(keys) if isinstance(keys, dict) else keys for section, keys in SOUND.items()}
    for (section, key), value in values.items():
        changed[section][key] = value
    file = tmp_path / "config.yaml"
    file.write_text(yaml.safe_dump(changed, allow_unicode=True), encoding="utf-8")
    is_refused(load_config, file)


def places(document: Any) -> Iterator[tuple[Any, ...]]:
    """The way to each value in what YAML or JSON has given."""
    within = document.items() if isinstance(document, dict) else enumerate(document)
    for key, value in within:
        yield (key,)
        if isinstance(value, dict | list):
            yield from ((key, *inner) for inner in places(value))


def with_others(document: Any, data: st.DataObject) -> Any:
    """A copy with one to three of its values exchanged for what YAML can write."""
    document = copy.deepcopy(document)
    for _ in range(data.draw(st.integers(1, 3))):
        *way, last = data.draw(st.sampled_from(list(places(document))))
        within = document
        for key in way:
            within = within[key]
        within[last] = data.draw(VALUES)
    return document


@pytest.mark.slow
@EIGHTY
@given(st.data())
def test_any_value_in_a_map_is_taken_or_refused_in_one_line(tmp_path: Path, data: st.DataObject) -> None:
    """Changes the one in docs/map.md."""
    file = tmp_path / "markers.yaml"
    file.write_text(yaml.safe_dump(with_others(yaml.safe_load(MAP), data), allow_unicode=True), encoding="utf-8")
    is_refused(load_map, file)


@pytest.fixture(scope="module")
def sound_take(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of three frames, with a line of truth."""
    take = tmp_path_factory.mktemp("sound") / "take"
    write_recording(take, 3)
    marker = {"id": 7, "corners_px": [[1, 2], [3, 2], [3, 4], [1, 4]], "position_m": [0, 0, 1], "optional": True}
    truth = {"seq": 1, "markers": [{**marker, "quaternion_wxyz": [0, 1, 0, 0]}]}
    (take / "truth.jsonl").write_text(json.dumps(truth) + "\n", encoding="utf-8")
    assert load_recording(take).truth is not None
    return take


@pytest.mark.slow
@EIGHTY
@given(st.data())
def test_any_value_in_a_recording_is_taken_or_refused_in_one_line(sound_take: Path, data: st.DataObject) -> None:
    """Changes its header, a frame's line, or the truth's."""
    file = sound_take / data.draw(st.sampled_from(["recording.yaml", "frames.jsonl", "truth.jsonl"]))
    sound = file.read_text(encoding="utf-8")
    first, _, rest = sound.partition("\n")
    try:
        if file.suffix == ".yaml":
            changed = yaml.safe_dump(with_others(yaml.safe_load(sound), data), allow_unicode=True)
        else:
            changed = json.dumps(with_others(json.loads(first), data), default=str) + "\n" + rest
        file.write_text(changed, encoding="utf-8")
        is_refused(load_recording, sound_take)
    finally:
        file.write_text(sound, encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["recording.yaml", "frames.jsonl"])
def test_a_damaged_recording_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    """A hundred of each file."""
    take, rng, refused = tmp_path / "take", random.Random(name), 0
    write_recording(take, 3)
    sound = (take / name).read_bytes()
    for _ in range(100):
        (take / name).write_bytes(damaged(sound, rng))
        refused += is_refused(load_recording, take)
    assert refused > 30


def test_a_damaged_map_is_refused_in_one_line(tmp_path: Path) -> None:
    """Two hundred of the one in docs/map.md."""
    rng, file, refused = random.Random(3), tmp_path / "markers.yaml", 0
    sound = MAP.encode()
    file.write_bytes(sound)
    assert len(load_map(file)) >= 4
    for _ in range(200):
        file.write_bytes(damaged(sound, rng))
        refused += is_refused(load_map, file)
    assert refused > 60


# ---- The commands that read them


@pytest.fixture
def complaint(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[[list[str]], str]:
    """The one line on standard error of a command that ends with status 2."""

    def of(command: list[str]) -> str:
        monkeypatch.setattr(logging, "basicConfig", lambda **_: None)  # pytest's own handlers stay
        return one_complaint(in_process(monkeypatch, capsys)(*command))

    return of


def two_refused(file: Path, read: Callable[[Path], object], place: Path) -> Iterator[None]:
    """Damages `file` until `place` is refused, twice."""
    sound, rng, refused = file.read_bytes(), random.Random(file.name), 0
    while refused < 2:
        file.write_bytes(damaged(sound, rng))
        if is_refused(read, place):
            refused += 1
            yield


SIDE = ["--set", "panels.side_m=0.16"]


@pytest.mark.slow
def test_every_command_refuses_a_configuration(
    tmp_path: Path, sound_take: Path, complaint: Callable[[list[str]], str]
) -> None:
    """With status 2 and one line that names it."""
    file = tmp_path / "config.yaml"
    shutil.copy(ROOT / "config.yaml", file)
    with_it = ["--config", str(file)]
    for _ in two_refused(file, load_config, file):
        for name in ("run", "snapshot", "calibrate"):
            assert str(file) in complaint([name, *with_it])
        for name in ("decode", "record"):
            assert str(file) in complaint([name, *with_it, str(sound_take)])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["recording.yaml", "frames.jsonl"])
def test_every_command_refuses_a_recording(
    tmp_path: Path, sound_take: Path, complaint: Callable[[list[str]], str], name: str
) -> None:
    """With status 2 and one line that names it."""
    take = tmp_path / "take"
    shutil.copytree(sound_take, take)
    for _ in two_refused(take / name, load_recording, take):
        for command in ("run", "snapshot"):
            assert str(take) in complaint([command, *SIDE, "--set", f"camera.source=recording:{take}"])
        assert str(take) in complaint(["decode", *SIDE, str(take)])
        assert str(take) in complaint(["calibrate", "shutter", *SIDE, str(take)])
