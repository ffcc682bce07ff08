"""From a frame that is ready to its first byte on the wire: the unmodified daemon on a recording, paced as its sensor.

A still panel, so the place of its centre row is known, and with it the time from mid-exposure to the end of the
frame's read-out, at which the recording delivers it. What a packet's age is more than that, is time that ledpi took:
the frame's hand-over, decoding, and the wait for the line. Exit status 1 where the 99th percentile is more than the
median decoding time (which the daemon reports) and --allow-ms. The pictures are stored uncompressed and in memory: a
sensor needs neither a processor to unpack them nor a disk.

    python -m benchmarks.speed latency [--seconds 30] [--allow-ms 1]
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ledpi.recording.reader import load_recording
from tests.builders.daemon import controller, daemon, end, write_recording

IN_MEMORY = Path("/dev/shm")  # where there is such a thing
FRAMES = 600  # of the recording, which is repeated: in each first one, nothing is followed yet


@dataclass(frozen=True, slots=True, kw_only=True)
class Latency:
    """What a run came to, in milliseconds."""

    packets: int
    decode_p50: float
    decode_p99: float
    p25: float
    p50: float
    p99: float
    largest: float

    @property
    def line(self) -> str:
        return (
            f"{self.packets} packets; frame ready → first byte: median {self.p50:.2f} ms, p99 {self.p99:.2f} ms, "
            f"largest {self.largest:.2f} ms; decoding: median {self.decode_p50:.2f} ms, p99 {self.decode_p99:.2f} ms"
        )


def mid_exposure_to_ready_ms(take: Path, centre_row: float) -> float:
    """From mid-exposure of a row to the end of the frame's read-out: its rows are read out below it, and half of T."""
    camera = load_recording(take).camera
    return float((camera.height - centre_row) * camera.row_time_us + camera.exposure_us / 2) / 1e3


def measure(seconds: float, *, frames: int = FRAMES, warm_up: int = 200, centre_row: float = 239.5) -> Latency:
    """Runs the daemon for so long after `warm_up` packets, with a receiver that reads all at once."""
    place = IN_MEMORY if IN_MEMORY.is_dir() else None
    with tempfile.TemporaryDirectory(dir=place) as folder, controller() as line:
        take = Path(folder) / "take"
        write_recording(take, frames)  # a panel 1 m straight ahead: its centre is the picture's
        for picture in (take / "frames").iterdir():
            content = cv2.imread(str(picture), cv2.IMREAD_UNCHANGED)
            assert content is not None
            cv2.imwrite(str(picture), content, [cv2.IMWRITE_PNG_COMPRESSION, 0])
        settings = (f"camera.source=recording:{take}", f"serial.port={line.port}")
        with daemon(*settings, options=("--frames", "1000000")) as process:
            line.wait_for(lambda c: len(c.markers) > warm_up)
            first = len(line.markers)
            time.sleep(seconds)
            assert end(process, signal.SIGTERM).status == 0
        line.close()
        ages_ms = np.array([marker.age_us for marker in line.markers[first:]]) / 1e3
        status = line.statuses[-1][1]
        latency_ms = ages_ms - mid_exposure_to_ready_ms(take, centre_row)
    return Latency(
        packets=len(latency_ms),
        decode_p50=(status.decode_p50_us or 0) / 1e3,
        decode_p99=(status.decode_p99_us or 0) / 1e3,
        p25=float(np.percentile(latency_ms, 25)),
        p50=float(np.median(latency_ms)),
        p99=float(np.percentile(latency_ms, 99)),
        largest=float(latency_ms.max()),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--allow-ms", type=float, default=1.0)
    arguments = parser.parse_args()
    latency = measure(arguments.seconds)
    print(latency.line)
    sys.exit(0 if latency.p99 <= latency.decode_p50 + arguments.allow_ms else 1)


if __name__ == "__main__":
    main()
