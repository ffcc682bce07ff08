"""The cost of capturing a frame beside picamera2's own, and beside the one copy that it must make.

    scripts/virtual-camera && .cache/virtual-camera/bin/python -m evaluation.speed capture

The real picamera2 and libcamera on libcamera's virtual camera. CPU time of the capturing thread, in microseconds a
frame, medians: picamera2's part is asking for a request, waiting for it, mapping its buffer, reading its metadata and
giving it back; ledpi's is all that `read` does beyond that. The copy is timed where it happens, out of a buffer that
another thread has filled.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ledpi.camera.picamera import open_picamera
from ledpi.config.settings import CameraSettings
from ledpi.core.records import Pixels
from tests.builders.virtual_picamera2 import Behaviour, show, use

FRAMES = 300


def cpu_us(work: Callable[[], object]) -> float:
    """Median CPU time of this thread for one call."""
    times = []
    for _ in range(FRAMES):
        start = time.thread_time_ns()
        work()
        times.append((time.thread_time_ns() - start) / 1e3)
    return statistics.median(times)


def main() -> None:
    from picamera2 import MappedArray  # which virtual_picamera2 has made importable

    behaviour, into = Behaviour(), np.zeros((480, 640), np.uint8)
    copy, copies = np.copyto, list[float]()

    def theirs() -> None:
        request = behaviour.opened[0].capture_request(wait=False).get_result(timeout=1.0)
        with MappedArray(request, "main", write=False):
            request.get_metadata()
        request.release()

    def timed_copy(to: Pixels, source: Pixels) -> None:
        start = time.thread_time_ns()
        copy(to, source)
        copies.append((time.thread_time_ns() - start) / 1e3)

    with tempfile.TemporaryDirectory() as folder:
        show(Path(folder), [np.random.default_rng(0).integers(0, 255, (480, 640), np.uint8)])
        use(behaviour, setattr)
        camera = open_picamera(CameraSettings(), (1250.0, 2450.0))
        own, whole = cpu_us(theirs), cpu_us(lambda: camera.read(into))
        np.copyto = timed_copy  # type: ignore[assignment]
        cpu_us(lambda: camera.read(into))
        camera.close()
    one = statistics.median(copies)
    print(f"read {whole:.0f} µs = picamera2 {own:.0f} µs + ledpi {whole - own:.0f} µs, of which one copy {one:.0f} µs")


if __name__ == "__main__":
    main()
