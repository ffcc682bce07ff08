"""`python -m evaluation.accuracy`."""

from __future__ import annotations

import sys

from evaluation import ROOT
from evaluation.running import Part, run

SHARED = ROOT.parent / "shared"
PARTS = (
    Part("bound"),
    Part("corners"),
    Part("false_ids"),
    Part("recordings", (str(SHARED / "recordings"),), path=SHARED / "recordings"),
    Part("led_bands", path=SHARED / "real/led_bands"),
    Part("led_panels", path=SHARED / "real/led_bands"),
    Part("panel_driver"),
)

if __name__ == "__main__":
    sys.exit(run("evaluation.accuracy", PARTS))
