"""From a frame that is ready to its first byte on the wire: the unmodified daemon on a recording, paced as its sensor.

A still panel, so the place of its centre row is known, and with it the time from mid-exposure to the end of the
frame's read-out, at which the recording delivers it. What a packet's age is more than that, is time that ledpi took:
the frame's hand-over, decoding, and the wait for the line. Exit status 1 where the 99th percentile is more than the
median decoding time (which the daemon reports) and --allow-ms. The pictures are stored uncompressed and in memory: a
sensor needs neither a processor to unpack them nor a disk.

    python -m evaluation.speed.latency [--seconds 30] [--allow-ms 1]
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ledpi.camera.recording.reader import load_recording
from ledpi.core.records import Floats
from ledpi.wire import MarkerMessage
from tests.builders.daemon import LIFE_S, controller, daemon, end, write_recording

IN_MEMORY = Path("/dev/shm")  # where there is such a thing
CENTRE_ROW = 239.5  # of the panel, and of the picture
WARM_UP = 200  # packets
FRAMES = 600  # of the recording, which is repeated: in each first one, nothing is followed yet


@dataclass(frozen=True, slots=True, kw_only=True)
class Latency:
    """The results of a run, in milliseconds."""

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


@contextmanager
def recording_in_memory(frames: int = FRAMES, *, plain: bool = False) -> Iterator[Path]:
    """A panel 1 m straight ahead, its centre in the picture's, where neither disk nor processor delays a picture."""
    place = IN_MEMORY if IN_MEMORY.is_dir() else None
    with tempfile.TemporaryDirectory(dir=place) as folder:
        take = Path(folder) / "take"
        write_recording(take, frames, plain=plain)
        for picture in (take / "frames").iterdir():
            content = cv2.imread(str(picture), cv2.IMREAD_UNCHANGED)
            assert content is not None
            cv2.imwrite(str(picture), content, [cv2.IMWRITE_PNG_COMPRESSION, 0])
        yield take


def latencies_ms(markers: Sequence[MarkerMessage], take: Path, centre_row: float = CENTRE_ROW) -> Floats:
    """Latency of each packet: from the frame that is ready to its first byte."""
    camera = load_recording(take).camera
    # From mid-exposure of a row to the end of the frame's read-out: its rows are read out below it, and half of T.
    ready_us = (camera.height - centre_row) * camera.row_time_us + camera.exposure_us / 2
    return (np.array([marker.age_us for marker in markers]) - ready_us) / 1e3


def measure(seconds: float, *, frames: int = FRAMES, warm_up: int = WARM_UP, centre_row: float = CENTRE_ROW) -> Latency:
    """Runs the daemon for so long after `warm_up` packets, with a receiver that reads all at once."""
    with recording_in_memory(frames) as take, controller() as line:
        settings = (f"camera.source=recording:{take}", f"serial.port={line.port}")
        with daemon(*settings, options=("--frames", "1000000"), life_s=LIFE_S + seconds) as process:
            line.wait_for(lambda c: len(c.markers) > warm_up)
            first = len(line.markers)
            time.sleep(seconds)
            assert end(process, signal.SIGTERM).status == 0
        line.close()
        latency_ms = latencies_ms(line.markers[first:], take, centre_row)
        status = line.statuses[-1][1]
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
