"""Instructions of a frame with one panel, searched and followed, beside those of detectMarkers on the same.

Counted by valgrind's callgrind, so what else the machine does changes nothing. Each kind is counted by a process that
decodes some more such frames than another one. Exit status 1 where a figure is more than a tenth above that in
instructions.json; `--renew` writes new ones there (Debian 12's Python and gcc, today's packages). Takes minutes.

    python -m benchmarks.speed instructions [--renew]
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2

from benchmarks import ROOT
from benchmarks.speed.panels import frames_of, pipeline_of, scene_of

FIGURES = Path(__file__).with_name("instructions.json")
OURS = ("searched", "followed")
KINDS = ("detectMarkers", *OURS)
MORE, WARM_UP = 3, 6  # frames
MOST_GROWTH = 0.1


def decode(pictures: Path, kind: str) -> None:
    """What is counted: warms all up, then, where `kind` is one of KINDS, MORE of its frames."""
    cv2.setNumThreads(1)
    frames, scene = pickle.loads(pictures.read_bytes()), scene_of(1)
    single, stream = (pipeline_of(scene, stream=each) for each in (False, True))
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    for frame in frames[:WARM_UP]:
        stream.decode(frame)
    single.decode(frames[0])
    detector.detectMarkers(frames[0].pixels)
    for frame in frames[WARM_UP:]:
        if kind == "searched":
            assert len(single.decode(frame).markers) == 1
        elif kind == "followed":
            assert len(stream.decode(frame).markers) == 1
        elif kind == "detectMarkers":
            detector.detectMarkers(frame.pixels)


def counted(pictures: Path, kind: str) -> int:
    """Instructions of a process that decodes so."""
    given = ["--pictures", str(pictures), "--kind", kind]
    command = [
        "valgrind",
        "--tool=callgrind",
        "--callgrind-out-file=/dev/null",
        sys.executable,
        "-m",
        __spec__.name,
        *given,
    ]
    done = subprocess.run(
        command, cwd=ROOT, env=os.environ | {"PYTHONHASHSEED": "0"}, capture_output=True, text=True, check=False
    )
    found = re.search(r"Collected : (\d+)", done.stderr)
    if done.returncode or found is None:
        raise SystemExit(f"valgrind: {done.stderr[-2000:]}")
    return int(found[1])


def thousands_a_frame() -> dict[str, int]:
    """By kind."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(os.cpu_count()) as pool:
        pictures = Path(folder) / "frames"
        pictures.write_bytes(pickle.dumps(frames_of(scene_of(1), WARM_UP + MORE)))
        none, *others = pool.map(counted, [pictures] * (1 + len(KINDS)), ["none", *KINDS])
    return {kind: round((count - none) / MORE / 1e3) for kind, count in zip(KINDS, others, strict=True)}


def grown(now: dict[str, int], before: dict[str, int]) -> list[str]:
    """The kinds of ours of which a frame takes more than a tenth more than before."""
    return [kind for kind in OURS if now[kind] > (1.0 + MOST_GROWTH) * before[kind]]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--renew", action="store_true", help="write the figures, to compare with from now on")
    parser.add_argument("--pictures", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--kind", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.pictures is not None:
        decode(arguments.pictures, arguments.kind)
        return 0
    now, before = thousands_a_frame(), json.loads(FIGURES.read_text(encoding="utf-8"))
    for kind in KINDS:
        was = f", {before[kind] / 1e3:.1f} before" if kind in OURS else ""
        print(f"{kind:14} {now[kind] / 1e3:6.1f} million instructions a frame{was}, {now[kind] / now[KINDS[0]]:.2f} ×")
    if arguments.renew:
        FIGURES.write_text(json.dumps({kind: now[kind] for kind in OURS}, indent=1) + "\n", encoding="utf-8")
        return 0
    for kind in (failed := grown(now, before)):
        print(f"{kind}: more than a tenth above; where that is meant: python -m benchmarks.speed instructions --renew")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
