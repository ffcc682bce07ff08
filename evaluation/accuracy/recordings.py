"""Recordings with truth → how many panels were read, how exactly, and how fast beside OpenCV's detectMarkers.

Both are timed on the same frames, in turn, in one process, OpenCV on one thread; the figure is the median of the
processor's time, so that whatever else runs on the machine hardly shows. Those of stages (in brackets) are of the
clock's: to ask for the processor's at each costs as much as a stage.

    python -m evaluation.accuracy.recordings [--stream] RECORDING…
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np

from ledpi.camera.recording.reader import Recording, find_recordings, load_recording
from ledpi.config.settings import load_config
from ledpi.core.records import Decoded
from ledpi.pipeline.pipeline import Pipeline
from ledpi.workshop.evaluate.scoring import Expected, Tally, read_of
from ledpi.workshop.evaluate.table import frame_of

ROUNDS = 3  # of every frame; the first warms caches up and is not timed


def pipeline_for(recording: Recording, *, stream: bool) -> Pipeline:
    camera = recording.camera
    return Pipeline(
        camera,
        load_config(None, ("panels.side_m=1",)).panels,
        intrinsics=camera.intrinsics,
        source_panel=recording.panel_values,
        stream=stream,
    )


def timed(recording: Recording, *, stream: bool) -> Iterator[tuple[float, float, Decoded]]:
    """Yields of each frame detectMarkers' time and ours (ms), and what we made of it."""
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, recording.dictionary)))
    pipeline = pipeline_for(recording, stream=stream)
    for entry in recording.frames:
        frame = frame_of(recording, entry)
        start = time.thread_time()
        detector.detectMarkers(frame.pixels)
        between = time.thread_time()
        decoded = pipeline.decode(frame)
        yield 1e3 * (between - start), 1e3 * (time.thread_time() - between), decoded


def measure(recording: Recording, name: str, *, stream: bool) -> None:
    """Prints a line."""
    rounds = [list(timed(recording, stream=stream)) for _ in range(ROUNDS)]
    theirs, ours = np.median([taken[:2] for each in rounds[1:] for taken in each], axis=0)
    stages = [decoded.stage_ms for each in rounds[1:] for _, _, decoded in each]
    tally = Tally()
    for *_, decoded in rounds[-1]:
        truth = (recording.truth or {}).get(decoded.seq, ())
        tally.add(read_of(decoded), [Expected.from_truth(marker) for marker in truth], name)
    parts = ", ".join(f"{s} {np.median([each[s] for each in stages]):.2f}" for s in stages[0])
    errors = (tally.corner_px, tally.position_percent, tally.angle_deg)
    median = [f"{np.median(each):.3g}" if each else "–" for each in errors]
    print(
        f"{name:24} read {tally.recognised:4}/{tally.expected:<4} wrong {tally.false_ids}  corners {median[0]:>6} px  "
        f"position {median[1]:>6} %  angle {median[2]:>6}°  {ours:6.2f} ms, detectMarkers {theirs:6.2f} ms, "
        f"ratio {ours / theirs:.2f}  ({parts})"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("paths", nargs="+", type=Path, metavar="RECORDING")
    parser.add_argument("--stream", action="store_true", help="frames follow each other; default: each alone")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    for path in arguments.paths:
        for folder in find_recordings(path):
            name = str(folder.relative_to(path)) if folder != path else folder.name
            measure(load_recording(folder), name, stream=arguments.stream)


if __name__ == "__main__":
    main()
