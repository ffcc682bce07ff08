"""`python -m benchmarks.speed`."""

from __future__ import annotations

import sys

from benchmarks.running import Part, run

PARTS = (
    Part("panels"),
    Part("worst_frames", ("--only", "/600/4X4_50/")),  # all of them take a quarter of an hour
    Part("latency"),
    Part("viewers"),
    Part("capture", module="libcamera"),
)

if __name__ == "__main__":
    sys.exit(run("benchmarks.speed", PARTS))
