"""`python -m benchmarks.speed`."""

from __future__ import annotations

import sys

from benchmarks.running import Part, run

PARTS = (Part("panels"), Part("latency"), Part("viewers"), Part("capture", module="libcamera"))

if __name__ == "__main__":
    sys.exit(run("benchmarks.speed", PARTS))
