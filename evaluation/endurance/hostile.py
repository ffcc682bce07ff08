"""Input that was made to bring a reader down: does it fail, hang, or say what is no number?

`scene`: hostile pictures, into `Pipeline.decode`; `recording`: damaged recordings and maps, read and decoded as `ledpi
run` does. `attack.py` runs this on a core that sanitizers watch. Each depends on seed and number alone; its number is
printed before it is read.

    python -m evaluation.endurance.hostile scene|recording [--seconds 60] [--most 100] [--seed 0] [--only 12345]
"""

from __future__ import annotations

import argparse
import itertools
import logging
import os
import sys
import time
import warnings
from collections.abc import Iterable
from dataclasses import dataclass

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from evaluation.endurance import hostile_frames, hostile_recordings
from ledpi.core.errors import LedpiError
from ledpi.core.records import Decoded

ATTACKS = {"scene": hostile_frames.attack, "recording": hostile_recordings.attack}


@dataclass
class Tally:
    """Counts of what has been read so far."""

    done: int = 0
    refused: int = 0
    frames: int = 0
    markers: int = 0
    fixes: int = 0
    slowest_s: float = 0.0  # of a whole scene or recording
    slowest: int = 0

    def read(self, number: int, attack: Iterable[Decoded]) -> None:
        """One of them. Raises ValueError where a place is none, or a complaint has several lines."""
        began_s = time.monotonic()
        try:
            for decoded in attack:
                check_numbers(decoded)
                self.frames += 1
                self.markers += len(decoded.markers)
                self.fixes += decoded.robot is not None
        except LedpiError as error:
            if "\n" in str(error):
                raise ValueError("a complaint of several lines") from error
            self.refused += 1
        self.done += 1
        self.slowest_s, self.slowest = max((self.slowest_s, self.slowest), (time.monotonic() - began_s, number))


def check_numbers(decoded: Decoded) -> None:
    """Raises ValueError where a place is none."""
    poses = [] if decoded.robot is None else [decoded.robot.map_from_base_link]
    for marker in decoded.markers:
        poses += [s.camera_from_marker for s in (marker.solution, marker.alternate) if s is not None]
    values = [marker.detection.corners_px for marker in decoded.markers]
    for pose in poses:
        values += [pose.position_m, pose.quaternion_wxyz]
        if pose.covariance is not None:
            values.append(pose.covariance)
    if not all(np.isfinite(value).all() for value in values):
        raise ValueError(f"frame {decoded.seq}: {decoded.markers} {decoded.robot}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("what", choices=list(ATTACKS))
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--most", type=int, default=sys.maxsize, help="so many, if time is left")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int, metavar="NUMBER", help="this one only")
    asked = parser.parse_args()
    warnings.simplefilter("error", RuntimeWarning)  # numpy's, of what is no number
    logging.disable()  # each picture that cannot be read has a line there
    tally, ends_s = Tally(), time.monotonic() + asked.seconds
    for number in itertools.count() if asked.only is None else [asked.only]:
        if tally.done >= asked.most or time.monotonic() >= ends_s:
            break
        print(f"{asked.what} {number}", flush=True)
        tally.read(number, ATTACKS[asked.what](asked.seed, number))
    print(tally)


if __name__ == "__main__":
    main()
