"""Configurations, maps and recordings that were damaged at random: each is read, or refused in one line."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from daemon_material import ROOT, write_recording
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ledpi.config import load_config
from ledpi.errors import LedpiError
from ledpi.map_yaml import load_map
from ledpi.recording import load_recording

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
    """Whether it is not taken; in one line, which names the place. Any other error ends the test."""
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
KEYS = sorted((section, key) for section, keys in SOUND.items() if isinstance(keys, dict) for key in keys)


@settings(
    max_examples=80,
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(st.dictionaries(st.sampled_from(KEYS), VALUES, min_size=1, max_size=3))
def test_any_value_is_taken_or_refused_in_one_line(tmp_path: Path, values: dict[tuple[str, str], object]) -> None:
    """Of one to three keys of the configuration that is shipped: what YAML can write."""
    changed = {section: dict(keys) if isinstance(keys, dict) else keys for section, keys in SOUND.items()}
    for (section, key), value in values.items():
        changed[section][key] = value
    file = tmp_path / "config.yaml"
    file.write_text(yaml.safe_dump(changed, allow_unicode=True), encoding="utf-8")
    is_refused(load_config, file)


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
    page = (ROOT / "docs/map.md").read_text(encoding="utf-8")
    sound = page.partition("```yaml\n")[2].partition("```")[0].encode()
    file.write_bytes(sound)
    assert len(load_map(file)) >= 4
    for _ in range(200):
        file.write_bytes(damaged(sound, rng))
        refused += is_refused(load_map, file)
    assert refused > 60
