"""Recordings that were damaged, given to whatever reads and decodes them: is each decoded, or refused in one line?

A recording of the simulated drive, and a map of its panels, are damaged in one to three ways: numbers of the header,
of the frames or of the map become others, at and beyond the limits, or none; bytes of these files are flipped, lost or
cut off; pictures are cut off, damaged, of another size, or show noise.
"""

from __future__ import annotations

import json
import math
import random
import shutil
import tempfile
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from ledpi.camera.factory import open_camera
from ledpi.camera.recording.writer import RecordingWriter
from ledpi.config.settings import load_config
from ledpi.core.records import Decoded, Frame
from ledpi.pipeline.pipeline import Pipeline, load_robot

FRAMES = 4
HEADER, LINES, MAP = "recording.yaml", "frames.jsonl", "markers.yaml"
PLACES = """
format: 1
deviations: {position_m: 0.01, angle_deg: 1.0}
panels:
  7: {position_m: [2.75, 0.22, 0.05], yaw_deg: 172}
  23: {position_m: [3.0, -0.25, -0.06], yaw_deg: 195, side_m: 0.16, deviations: {position_m: 0.03, angle_deg: 2}}
"""
FACTORS = (-1.0, 1e-9, 0.01, 0.5, 1 - 1e-9, 1 + 1e-9, 1.03, 2.0, 100.0, 1e9)
# Limits of one value or another, and what is no number.
VALUES = (0, 1, -1, 10, 1000, 5000, 100_000, 10_000_000, 0.001, 0.01, 0.99, 1e300, 5e-324, 2**63, math.nan, math.inf)


def write_sound(folder: Path) -> None:
    """The drive's first frames, and where its panels are."""
    config = load_config(None, ("camera.source=simulated",))
    camera = open_camera(config, paced=False, frames=FRAMES)
    into = np.empty((camera.info.height, camera.info.width), np.uint8)
    panels = config.panels
    with RecordingWriter(folder, camera=camera.info, dictionary=panels.dictionary, panel=panels.spec()) as writer:
        while isinstance(frame := camera.read(into), Frame):
            writer.write(frame)
    (folder / MAP).write_text(PLACES, encoding="utf-8")


def _another(value: float, rng: random.Random) -> float:
    """Another number, or none."""
    if rng.random() < 0.6:
        changed = value * rng.choice(FACTORS)
        return round(changed) if isinstance(value, int) else changed
    return rng.choice(VALUES)


def _numbers(document: Any) -> Iterator[tuple[Any, Any]]:
    """Each number in what YAML or JSON has given: what holds it, and its key or index there."""
    for key, value in list(document.items() if isinstance(document, dict) else enumerate(document)):
        if isinstance(value, dict | list):
            yield from _numbers(value)
        elif isinstance(value, int | float):
            yield document, key


def _change_number(document: Any, rng: random.Random) -> None:
    holder, key = rng.choice(list(_numbers(document)))
    holder[key] = _another(holder[key], rng)


def _change_yaml(take: Path, rng: random.Random, name: str) -> None:
    document = yaml.safe_load((take / name).read_text(encoding="utf-8"))
    _change_number(document, rng)
    (take / name).write_text(yaml.safe_dump(document), encoding="utf-8")


def _change_line(take: Path, rng: random.Random) -> None:
    lines = (take / LINES).read_text(encoding="utf-8").splitlines()
    at = rng.randrange(len(lines))
    line = json.loads(lines[at])
    _change_number(line, rng)
    lines[at] = json.dumps(line)
    (take / LINES).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _damage_bytes(take: Path, rng: random.Random) -> None:
    file = rng.choice([take / HEADER, take / LINES, take / MAP, *sorted((take / "frames").iterdir())])
    content = bytearray(file.read_bytes())
    start = rng.randrange(len(content) + 1)
    end = min(len(content), start + rng.choice((1, 4, 100, len(content))))
    replaced = rng.choice((b"", rng.randbytes(end - start), bytes(end - start)))
    file.write_bytes(content[:start] + replaced + content[end:])


def _change_picture(take: Path, rng: random.Random) -> None:
    picture = rng.choice(sorted((take / "frames").iterdir()))
    height, width = rng.choice(((480, 640), (480, 640), (640, 480), (1, 1), (481, 640), (3000, 3000)))
    pixels = np.random.default_rng(rng.getrandbits(32)).integers(0, 256, (height, width)).astype(np.uint8)
    cv2.imwrite(str(picture), pixels)


DAMAGES: tuple[Callable[[Path, random.Random], None], ...] = (
    *(partial(_change_yaml, name=name) for name in (HEADER, HEADER, MAP, MAP)),
    *(_change_line, _damage_bytes, _change_picture),
)


def damage(take: Path, rng: random.Random) -> None:
    """One to three faults; what another one has made unreadable stays as it is."""
    for _ in range(rng.randint(1, 3)):
        try:
            rng.choice(DAMAGES)(take, rng)
        except (ValueError, IndexError, AttributeError, TypeError, yaml.YAMLError):
            continue


def decode(take: Path) -> Iterator[Decoded]:
    """Yields what each frame has come to, as with `ledpi run`. Raises LedpiError where it is refused."""
    config = load_config(None, (f"camera.source=recording:{take}", f"map={take / MAP}"))
    camera = open_camera(config, paced=False)
    into = np.empty((camera.info.height, camera.info.width), np.uint8)
    lens, robot = camera.info.intrinsics, load_robot(config)
    pipeline = Pipeline(camera.info, config.panels, intrinsics=lens, source_panel=camera.panel, robot=robot)
    while (frame := camera.read(into)) is not None:
        if isinstance(frame, Frame):
            yield pipeline.decode(frame)


@cache
def _sound() -> tempfile.TemporaryDirectory[str]:
    """One for the whole process, which removes it at its end."""
    folder = tempfile.TemporaryDirectory()
    write_sound(Path(folder.name) / "sound")
    return folder


def attack(seed: int, number: int) -> Iterator[Decoded]:
    """Damages a copy of a sound recording, and yields what each of its frames has come to."""
    sound, take = (Path(_sound().name) / name for name in ("sound", "take"))
    shutil.rmtree(take, ignore_errors=True)
    shutil.copytree(sound, take)
    damage(take, random.Random(f"{seed} {number}"))
    yield from decode(take)
