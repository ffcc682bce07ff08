"""`python -m evaluation.endurance`: an hour or more."""

from __future__ import annotations

import sys

from evaluation.running import Part, run

PARTS = (
    Part("attack"),
    Part("receivers"),
    Part("soak"),
    Part("crowd"),
    Part("bridges", module="paho"),
    Part("bridge_memory", module="paho"),
    Part("record", module="libcamera"),
)

if __name__ == "__main__":
    sys.exit(run("evaluation.endurance", PARTS))
