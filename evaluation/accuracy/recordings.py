"""Recordings with truth → how many panels were read, how exactly, and how fast beside OpenCV's detectMarkers.

Both are timed on the same frames, in turn, in one process, OpenCV on one thread; the figure is the median of the
processor's time, so that whatever else runs on the machine hardly shows. Those of stages (in brackets) are of the
clock's: to ask for the processor's at each costs as much as a stage.

    python -m evaluation.accuracy recordings [--stream] RECORDING…
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np

from ledpi.config.settings import load_config
from ledpi.core.geometry import rotation_angle_deg
from ledpi.core.records import Frame
from ledpi.pipeline.pipeline import Pipeline
from ledpi.recording.picture import read_picture
from ledpi.recording.reader import Recording, find_recordings, load_recording

ROUNDS = 3  # of every frame; the first warms caches up and is not timed


def frames_of(recording: Recording) -> list[Frame]:
    frames = []
    for entry in recording.frames:
        picture = np.empty((recording.camera.height, recording.camera.width), np.uint8)
        fault = read_picture(entry.picture, picture)
        if fault is not None:
            sys.exit(fault.message)
        frames.append(recording.frame(entry, picture))
    return frames


def pipeline_for(recording: Recording, *, stream: bool) -> Pipeline:
    camera = recording.camera
    return Pipeline(
        camera,
        load_config(None, ("panels.side_m=1",)).panels,
        intrinsics=camera.intrinsics,
        source_panel=recording.panel_values,
        stream=stream,
    )


def measure(recording: Recording, name: str, *, stream: bool) -> None:
    frames = frames_of(recording)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, recording.dictionary))
    detector = cv2.aruco.ArucoDetector(dictionary)
    ours: list[float] = []
    theirs: list[float] = []
    stages: list[dict[str, float]] = []
    decoded = []
    for round_number in range(ROUNDS):
        pipeline = pipeline_for(recording, stream=stream)
        decoded = []
        for frame in frames:
            start = time.thread_time()
            detector.detectMarkers(frame.pixels)
            between = time.thread_time()
            decoded.append(pipeline.decode(frame))
            end = time.thread_time()
            if round_number:
                theirs.append(between - start)
                ours.append(end - between)
                stages.append(decoded[-1].stage_ms)
    expected = found = wrong = 0
    corner_px, relative_m, angle_deg = [], [], []
    for result in decoded:
        truth = {m.id: m for m in (recording.truth or {}).get(result.seq, ())}
        expected += sum(not m.optional for m in truth.values())
        for marker in result.markers:
            true = truth.get(marker.detection.id)
            side = 0.0 if true is None else float(np.ptp(true.corners_px, axis=0).max())
            error = np.inf if true is None else np.hypot(*(marker.detection.corners_px - true.corners_px).T)
            if true is None or np.mean(error) > 0.25 * side:
                wrong += 1
                continue
            found += not true.optional
            corner_px.append(float(np.sqrt(np.mean(np.square(error)))))
            true_pose = true.camera_from_marker  # None of a photograph whose corners are known only
            if marker.solution is not None and true_pose is not None:
                pose = marker.solution.camera_from_marker
                distance = float(np.linalg.norm(true_pose.position_m))
                relative_m.append(float(np.linalg.norm(pose.position_m - true_pose.position_m)) / distance)
                angle_deg.append(rotation_angle_deg(pose.quaternion_wxyz, true_pose.quaternion_wxyz))
    parts = ", ".join(f"{s} {np.median([t[s] for t in stages]):.2f}" for s in stages[0])
    median = [f"{np.median(v):.3g}" if v else "–" for v in (corner_px, [100 * r for r in relative_m], angle_deg)]
    ratio = np.median(ours) / np.median(theirs)
    print(
        f"{name:24} read {found:4}/{expected:<4} wrong {wrong}  corners {median[0]:>6} px  position {median[1]:>6} %  "
        f"angle {median[2]:>6}°  {1e3 * np.median(ours):6.2f} ms, detectMarkers {1e3 * np.median(theirs):6.2f} ms, "
        f"ratio {ratio:.2f}  ({parts})"
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
