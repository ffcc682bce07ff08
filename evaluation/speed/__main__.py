"""`python -m evaluation.speed`."""

from __future__ import annotations

import sys
from pathlib import Path

from evaluation import ROOT
from evaluation.running import Part, run

SHARED = ROOT.parent / "shared"  # recordings that other code drew

PARTS = (
    Part("panels"),
    Part("ratios", tuple(str(SHARED / each) for each in ("foreign", "recordings")), path=SHARED),
    Part("worst_frames", ("--only", "/600/4X4_50/")),  # all of them take a quarter of an hour
    Part("instructions", path=Path("/usr/bin/valgrind")),
    Part("arm", path=Path("/usr/bin/qemu-aarch64")),
    Part("latency"),
    Part("viewers"),
    Part("bridges"),
    Part("capture", module="libcamera"),
)

if __name__ == "__main__":
    sys.exit(run("evaluation.speed", PARTS))
