"""Processor time of a frame of recordings, beside OpenCV's detectMarkers on the same frames, each alone and in streams.

Both take turns, frame by frame, in one process, OpenCV on one thread. A line a recording: the mean of either, and one
over the other; then of all whose exposure is more than a millisecond, and of the others.

    python -m evaluation.speed ratios RECORDING…
"""

from __future__ import annotations

import argparse
import os
from collections import defaultdict
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np

from evaluation.accuracy.recordings import timed
from ledpi.recording.reader import find_recordings, load_recording

LONG_US = 1000.0  # exposures of more than this leave faint bands


def line(name: str, taken: list[tuple[float, float]]) -> str:
    """Means over frames, and their ratio."""
    theirs, ours = np.mean(taken, axis=0).tolist()
    return f"{name:44} {len(taken):4} frames  {ours:6.2f} ms, detectMarkers {theirs:5.2f} ms, ratio {ours / theirs:.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("paths", nargs="+", type=Path, metavar="RECORDING")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    pooled = defaultdict[str, list[tuple[float, float]]](list)
    for folder in (folder for path in arguments.paths for folder in find_recordings(path)):
        recording = load_recording(folder)
        for way in ("alone", "stream"):
            taken = [each[:2] for each in timed(recording, stream=way == "stream")]
            pooled[f"all, {way}, {'faint' if recording.camera.exposure_us > LONG_US else 'deep'} bands"] += taken
            print(line(f"{folder.parent.name}/{folder.name}, {way}", taken), flush=True)
    print(*(line(name, taken) for name, taken in sorted(pooled.items())), sep="\n")


if __name__ == "__main__":
    main()
