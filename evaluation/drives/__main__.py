"""Drives through a room of 8 × 6 m with eight panels: how exact and how honest the state is.

The map is wrong by 1 cm and 1° a panel, each wheel slips, the gyro has bias and scale, a tenth of the frames is hidden,
and pictures are 60 ms late; looks err as in rendered drives, with their correlation in time (looks.py). Cases: `plain`;
`gaps` of 5 s without a panel, by gyro or by `gaps_wheels`; a robot that is `carried` off; a panel that is `moved`, also
where the state begins at it (`moved_first`); `turns` without wheels; `none` without odometry; a `clock` 10 ms off; and
docking, in closed loop by the example in C (docking.py); `batch` beside the causal optimum, and all plain
drives beside WPILib's estimator (others.py).

Writes drives.csv, a line for each drive, and drives.png to --out; a run that was broken off goes on. Exit status 1
where something asked is not met. `python -m evaluation.drives.cost` tells what it costs.

    python -m evaluation.drives [--drives 100] [--case plain …] [--out DIR] [--workers 2]
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from evaluation import ROOT, table
from evaluation.drives.cases import CASES
from evaluation.drives.measure import ASKED, OTHERS, Row, judge

COLUMNS = (
    *("case", "seed", "rms_mm", "raw_mm", "yaw_deg", "nees", "below_95", "within_3", "named", "innocent"),
    *("dock_mm", "dock_deg", "dock_s", "touched"),
    *("wpilib_docs_mm", "wpilib_stated_mm", "batch_mm", "causal_mm"),
    *("untouched_mm", "right_s", *(f"gap{n}_{of}" for n in (0, 1) for of in ("m", "mm", "nees")), "events"),
)


def kept(path: Path) -> list[Row]:
    """The drives that an earlier run has finished; a line that it had not is dropped."""
    if not path.exists():
        return []
    whole = path.read_text(encoding="utf-8").rpartition("\n")[0] + "\n"
    path.write_text(whole, encoding="utf-8")
    return list(csv.DictReader(whole.splitlines()))


def drive_all(path: Path, cases: list[str], drives: int, workers: int) -> list[Row]:
    """Adds a line for each drive that is not in the file; returns all that are."""
    done = {(row["case"], int(row["seed"])) for row in kept(path)}
    asked = [(case, seed) for case in cases for seed in range(drives) if (case, seed) not in done]
    with path.open("a", encoding="utf-8", newline="") as file, ProcessPoolExecutor(workers) as pool:
        lines = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        if not file.tell():
            lines.writeheader()
        for row in pool.map(judge, *zip(*asked, strict=True)) if asked else ():
            lines.writerow({name: f"{v:.5g}" if isinstance(v, float) else v for name, v in row.items()})
            file.flush()
    return kept(path)


def summary(rows: list[Row]) -> tuple[str, bool]:
    """The table of what is asked, and whether all of it is met."""
    lines, met = [], True
    for asked in ASKED:
        own = [row for row in rows if row["case"] == asked.case]
        if own:
            value = float(asked.value(own))
            well = asked.least <= value <= asked.most
            met &= well
            limits = f"{asked.least:g} to {asked.most:g}".replace("-inf to ", "≤ ").replace(" to inf", " or more")
            told = "" if limits == "≤ inf" else limits
            lines.append([asked.what, str(len(own)), told, f"{value:.3g}", "" if well else "NOT MET"])
    return table(["", "drives", "asked", "measured", ""], lines), met


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", type=int, default=100, help="of each case")
    cases = [*CASES, *OTHERS]
    parser.add_argument("--case", action="append", choices=cases, help="this one only; may be given again")
    parser.add_argument("--out", type=Path, default=ROOT / ".cache" / "drives", metavar="DIR")
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    rows = drive_all(asked.out / "drives.csv", asked.case or cases, asked.drives, asked.workers)
    told, met = summary(rows)
    print(told)
    from evaluation.drives.picture import draw

    draw(rows, asked.out / "drives.png")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
