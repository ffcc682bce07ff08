"""`ledpi record` at the camera's full rate: what is lost, and whether a replay decodes the same.

    scripts/virtual-camera && .cache/virtual-camera/bin/python -m evaluation.endurance record --seconds 60

The real picamera2 and libcamera on libcamera's virtual camera, 62.5 frames a second, three rendered panels in view.
Prints the command's own summary, the gaps in `seq`, and whether `ledpi decode --as-live` gives what live.jsonl holds,
apart from the times that decoding took.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import itertools
import json
import os
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

os.environ["LIBCAMERA_LOG_LEVELS"] = "*:FATAL"

from ledpi.cli import main as ledpi
from tests.builders.virtual_panels import SETTINGS, rendered
from tests.builders.virtual_picamera2 import Behaviour, show, use


def command(*arguments: str) -> str:
    """Returns what a command of ledpi prints, in this process, as only this one has the virtual camera."""
    sys.argv = ["ledpi", *arguments, *(part for item in SETTINGS for part in ("--set", item))]
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        ledpi()
    return said.getvalue()


def without_times(lines: Iterable[str]) -> list[dict[str, Any]]:
    return [{key: value for key, value in json.loads(line).items() if key != "decode_ms"} for line in lines]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", default="60")
    seconds = parser.parse_args().seconds
    with tempfile.TemporaryDirectory() as place:
        show(Path(place) / "shown", rendered())
        use(Behaviour(), setattr)
        take = Path(place) / "take"
        print(command("record", str(take), "--seconds", seconds).strip())
        seqs = [json.loads(line)["seq"] for line in (take / "frames.jsonl").read_text().splitlines()]
        live = without_times((take / "live.jsonl").read_text().splitlines())
        again = without_times(command("decode", "--as-live", str(take)).splitlines())
        detections = sum(len(frame["markers"]) for frame in live)
    gaps = {before: after - before - 1 for before, after in itertools.pairwise(seqs) if after - before > 1}
    print(f"gaps in seq: {sum(gaps.values())} frames{', after: ' if gaps else ''}{gaps or ''}")
    print(
        f"replay of {len(live)} decoded frames, {detections} detections: {'the same' if again == live else 'DIFFERS'}"
    )


if __name__ == "__main__":
    main()
