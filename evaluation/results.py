"""Today's figures, measured and written to docs/results.md: how much is read, what is read that is none, how fast.

    python -m evaluation.results [--takes 60] [--decoys 300] [--workers 2] [--out DIR] [--page FILE]

The suite wild of `ledpi evaluate`, its decoys, and the contest of evaluation/speed/panels.py. What DIR holds already,
of the same code, is not run again; so an interrupted run resumes.
"""

from __future__ import annotations

import argparse
import os
import subprocess
from collections.abc import Sequence
from contextlib import closing
from itertools import groupby
from pathlib import Path

from evaluation import ROOT, table

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from evaluation.endurance import bridges
from evaluation.speed import arm
from evaluation.speed import panels as contests
from evaluation.suites.conditions import Method, Suite
from evaluation.suites.plan import Plan
from evaluation.suites.units import code_version, run_on_processes
from evaluation.suites.wild_rows import WILD
from ledpi.config.settings import load_config
from ledpi.workshop.evaluate.page import ResultsFolder
from ledpi.workshop.evaluate.table import TableRow, wilson

SEED = 77001  # nothing was tuned on it
WILD_METHODS: tuple[Method, ...] = ("ledpi", "oracle", "aruco")
DECOY_METHODS: tuple[Method, ...] = ("likelihood", "stream")
EXPOSURES_US = (10_000.0, 150.0)  # of decoys
PANELS, SPEED_FRAMES = 8, 24

READ = """\
Everything is drawn at once: how the panel is built, the camera, the room, what is around the panel. Of 16 panels one
has a dead cell and one a hidden strip. IDs are drawn from all that exist where `panels.ids` is absent. In brackets:
the 95 % interval of the rate, which counts takes, not frames.

* *ledpi*: the whole path. Frame 1 is read alone; where it says 4 to 6, the stream is read from its first frame on.
* *true corners given*: the same evidence and words on the light within the true corners, of all frames until then.
* *printed marker*: an ArUco marker of the same size in the panel's place, lit as brightly but never up to full scale;
  OpenCV's `detectMarkers` with sub-pixel corners, each frame by itself.
* *false IDs*: of ledpi, with the true corners given, of the printed marker. Right IDs with a corner off by more
  than a quarter of the side count too."""

DECOYS = """\
Scenes with things that look like panels and show no word. Every ID exists here, also those that a part of a panel can
show. Frames of a scene are 12; each is read alone, and all as a stream. Panels of *hidden strip* and *dead cell* differ
from every word by two cells at least that are lit and open."""

SPEED = """\
Median processor time of a frame of 640 × 480 pixels, OpenCV on one thread, on the same frames in turn: panels at 1.4 m,
10 ms, in a room with textured walls. *Searching*: each frame alone. *Tracking*: in a stream, all panels read."""


INSTRUCTIONS = """\
Counted on emulated 64-bit ARM and on x86-64, with panels as above (`python -m evaluation.speed.arm --renew`).
*Searching*: no panel is in view. *First ID*: all frames of a stream until then. *Following*: the mean of six frames of
a stream, the whole picture searched in every third. [Which Pi, how fast](raspberry-pi.md#which-pi-how-fast) says what
that makes of a Raspberry Pi."""


BRIDGES = """\
Replayed taps at 60 frames a second through [bridges](outputs.md), all on one machine; half-way the far end is killed,
and started again 5 s later (`python -m evaluation.endurance.bridges --renew`). *mqtt*: a bridge of each tap into one
mosquitto, and a subscriber; *nt*: one into an ntcore server. *Late*: from when the tap had a frame until it arrived,
in the median, and in 99 of 100. *Back*: from the far end's start to the next frame. *Old*: older than 0.3 s after
that. *Memory*: what the bridge that gained most had more at the end. *Load*: processes that would run, on how many
processors."""


def rows_of(suite: Suite, frames: int, methods: tuple[Method, ...], out: Path, workers: int) -> list[TableRow]:
    """The suite's rows, whatever of them is not in `out` yet measured now."""
    plan = Plan(
        suites=(suite,),
        frames=frames,
        seed=SEED,
        exposures_us=EXPOSURES_US if suite == "decoys" else (),
        methods=methods,
        apriltag=False,
        panels=load_config(None, ("panels.side_m=0.16",)).panels,
        code=code_version(),
    )
    folder = ResultsFolder(out, plan.as_json())
    units = plan.units()
    left = [unit for unit in units if unit.key not in folder.finished]
    with closing(run_on_processes(left, workers)) as records:
        for record in records:
            folder.add(record)
            print(f"{suite}: {len(folder.finished)} of {len(units)}", flush=True)
    return plan.rows(folder.finished)


def read_table(rows: Sequence[TableRow]) -> str:
    """A line for each row of the suite wild."""
    head = ["", "distance", "turned by", "exposure", "frames", "ledpi", "true corners given", "printed marker"]
    lines = []
    for case, own in groupby(rows, lambda row: row.case):
        by = {row.method: row for row in own}
        asked, judged = WILD[case], WILD[case].judged
        near, far = asked.distance_m
        low, high = asked.yaw_deg
        where = [f"{near:g} to {far:g} m", f"{low:g} to {high:g}°", f"{asked.exposure_us / 1e3:g} ms"]
        which = f"{judged.start + 1}" + (f" to {judged.stop}" if len(judged) > 1 else "")
        false = [str(by[method].false_ids) for method in WILD_METHODS]
        lines.append([case, *where, which, *(rate(by[method]) for method in WILD_METHODS), ", ".join(false)])
    return table([*head, "false IDs"], lines)


def rate(row: TableRow) -> str:
    assert row.rate is not None
    low, high = wilson(row.rate * row.trials, row.trials)
    return f"{row.recognised} of {row.expected}: {row.rate:.0%} ({100 * low:.0f} to {100 * high:.0f})"


def errors_table(rows: Sequence[TableRow]) -> str:
    """Medians of what was read, ours and the printed marker's."""
    lines = []
    for case, own in groupby(rows, lambda row: row.case):
        by = {row.method: row for row in own}
        lines.append([case, *(errors(by[method]) for method in ("ledpi", "aruco"))])
    return table(["", "ledpi", "printed marker"], lines)


def errors(row: TableRow) -> str:
    if row.corner_px is None or row.position_percent is None or row.angle_error_deg is None:
        return "–"
    return f"{row.corner_px:.2g} px, {row.position_percent:.2g} %, {row.angle_error_deg:.2g}°"


def decoys_table(rows: Sequence[TableRow]) -> str:
    """A line for each kind and exposure; one for all."""
    lines, total = [], {"likelihood": [0, 0], "stream_all": [0, 0]}
    for (case, exposure_us), own in groupby(rows, lambda row: (row.case, row.exposure_us)):
        by = {row.method: row for row in own}
        false = []
        for method, sums in total.items():
            sums[0] += by[method].frames
            sums[1] += by[method].false_ids
            false.append(str(by[method].false_ids))
        lines.append([case.replace("_", " "), f"{exposure_us / 1e3:g} ms", str(by["likelihood"].frames), *false])
    frames = {sums[0] for sums in total.values()}
    lines.append(["all", "", str(frames.pop()), *(str(sums[1]) for sums in total.values())])
    return table(["decoys", "exposure", "frames", "false IDs, each frame alone", "false IDs, streams"], lines)


def false_ids(rows: Sequence[TableRow]) -> str:
    """Each of ours by itself; the take is written by `ledpi evaluate --take`."""
    how = {"likelihood": "alone", "stream_all": "stream"}
    said = [
        f"* {row.case.replace('_', ' ')}, {row.exposure_us / 1e3:g} ms, {how.get(row.method, row.method)}: {text}"
        for row in rows
        if row.method not in ("oracle", "aruco")
        for text in row.false
    ]
    return "\n".join(said) if said else "None."


def speed_table() -> str:
    """The contest of evaluation/speed/panels.py."""
    lines = []
    for contest in contests.contests_of(PANELS, SPEED_FRAMES):
        theirs = contest.median_ms(contests.THEIRS)
        ours = [contest.median_ms(name) for name in contests.OURS]
        shown = len(contest.scene.panels) * SPEED_FRAMES
        read = [sum(len(each.markers) for each in contest.decoded[name]) / shown for name in contests.OURS]
        cells = [f"{ms:.2f} ms, {ms / theirs:.2f}×, read {share:.0%}" for ms, share in zip(ours, read, strict=True)]
        lines.append([str(len(contest.scene.panels)), f"{theirs:.2f} ms", *cells])
    return table(["panels", "`detectMarkers`", "searching", "tracking"], lines)


def processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "not known")


def commit() -> str:
    """HEAD's, and whether what is measured differs from it."""

    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()

    changed = ", with changes" if git("status", "--porcelain", "--", "ledpi", "evaluation") else ""
    return git("rev-parse", "--short", "HEAD") + changed


def page(command: str, wild: Sequence[TableRow], decoys: Sequence[TableRow], speed: str) -> str:
    """All of it."""
    takes = wild[0].trials
    intro = (
        f"Written by `{command}` at commit {commit()}; not by hand. All frames are of our own simulator, which draws "
        f"{takes} takes a row; no real panel was photographed. Code {code_version()}."
    )
    parts = ["# Results", intro, "## How much is read", READ, read_table(wild)]
    parts += ["Medians of what was read: corners (rms of the four), position (of the distance), angle."]
    parts += [errors_table(wild)]
    parts += ["False IDs of ledpi:", false_ids(wild), "## Decoys: nothing may be read", DECOYS, decoys_table(decoys)]
    parts += ["False IDs:", false_ids(decoys), "## Bridges", BRIDGES, bridges.figures_table(bridges.kept())]
    parts += ["## How fast", f"{SPEED} Processor: {processor()}.", speed]
    parts += [INSTRUCTIONS, arm.counts_table(arm.kept())]
    return "\n\n".join(parts) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--takes", type=int, default=60, help="of each row of the suite wild")
    parser.add_argument("--decoys", type=int, default=300, help="frames of each kind, at each exposure")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=ROOT / ".cache" / "results", metavar="DIR")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "results.md", metavar="FILE")
    asked = parser.parse_args()
    wild = rows_of("wild", asked.takes, WILD_METHODS, asked.out / f"wild{asked.takes}", asked.workers)
    decoys = rows_of("decoys", asked.decoys, DECOY_METHODS, asked.out / f"decoys{asked.decoys}", asked.workers)
    command = f"python -m evaluation.results --takes {asked.takes} --decoys {asked.decoys}"
    asked.page.write_text(page(command, wild, decoys, speed_table()), encoding="utf-8")


if __name__ == "__main__":
    main()
