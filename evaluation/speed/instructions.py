"""Instructions of a frame with one panel, searched and followed, beside those of detectMarkers on the same.

Counted by valgrind's callgrind (counting.py), so what else the machine does changes nothing. Exit status 1 where a
figure is more than a tenth above that in instructions.json; `--renew` writes new ones there (Debian 12's Python and
gcc, today's packages). Takes a minute or two. `arm` counts more, on 64-bit ARM, too.

    python -m evaluation.speed.instructions [--renew]
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2

from evaluation.speed import counting
from evaluation.speed.panels import frames_of, pipeline_of, scene_of

FIGURES = Path(__file__).with_name("instructions.json")
OURS = ("searched", "followed")
KINDS = ("detectMarkers", *OURS)
MORE, WARM_UP = 3, 6  # frames
MOST_GROWTH = 0.1


def decode(pictures: Path) -> None:
    """Runs what is counted: of each of KINDS a stretch of MORE frames, once all is warm."""
    cv2.setNumThreads(1)
    frames, scene = pickle.loads(pictures.read_bytes()), scene_of(1)
    single, stream = (pipeline_of(scene, stream=each) for each in (False, True))
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    for frame in frames[:WARM_UP]:
        stream.decode(frame)
    single.decode(frames[0])
    detector.detectMarkers(frames[0].pixels)
    for kind in KINDS:
        counting.mark()
        for frame in frames[WARM_UP:]:
            if kind == "detectMarkers":
                detector.detectMarkers(frame.pixels)
            else:
                assert len((single if kind == "searched" else stream).decode(frame).markers) == 1
        counting.mark()


def thousands_a_frame() -> dict[str, int]:
    """By kind."""
    with counting.program_of(__spec__.name, frames_of(scene_of(1), WARM_UP + MORE)) as program:
        counts = counting.on_x86_64(program)
    return {kind: round(count / MORE / 1e3) for kind, count in zip(KINDS, counts, strict=True)}


def grown(now: dict[str, int], before: dict[str, int]) -> list[str]:
    """The kinds of ours of which a frame takes more than a tenth more than before."""
    return [kind for kind in OURS if now[kind] > (1.0 + MOST_GROWTH) * before[kind]]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--renew", action="store_true", help="write the figures, to compare with from now on")
    parser.add_argument("--pictures", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.pictures is not None:
        decode(arguments.pictures)
        return 0
    now, before = thousands_a_frame(), json.loads(FIGURES.read_text(encoding="utf-8"))
    for kind in KINDS:
        was = f", {before[kind] / 1e3:.1f} before" if kind in OURS else ""
        print(f"{kind:14} {now[kind] / 1e3:6.1f} million instructions a frame{was}, {now[kind] / now[KINDS[0]]:.2f} ×")
    if arguments.renew:
        FIGURES.write_text(json.dumps({kind: now[kind] for kind in OURS}, indent=1) + "\n", encoding="utf-8")
        return 0
    for kind in (failed := grown(now, before)):
        print(f"{kind}: more than a tenth above; where that is meant: python -m evaluation.speed.instructions --renew")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
