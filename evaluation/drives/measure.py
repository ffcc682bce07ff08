"""Figures of a drive, and what is asked of all of a case."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from evaluation.drives import others
from evaluation.drives.cases import CARRIED_S, CASES, PICTURE_LATE_NS, Case, Driven, drive_of, raw_fixes, run
from evaluation.drives.docking import DOCKINGS, docking_row
from ledpi.core.records import Floats

Row = Mapping[str, float | str]
THREE_DEVIATIONS, TAIL = 14.16, 7.81  # χ² of 3 that a normal exceeds as often as 3 deviations; in 5 of 100
RIGHT_M, RIGHT_RAD = 0.1, math.radians(5)  # as good as before, after the robot was carried off


OTHERS: dict[str, Callable[[int], Mapping[str, float]]] = {
    "batch": others.judge_optimum,
    **{name: partial(docking_row, asked) for name, asked in DOCKINGS.items()},
}


def judge(name: str, seed: int) -> dict[str, float | str]:
    """Drives once, and returns a line of the table."""
    if name in OTHERS:
        return {"case": name, "seed": seed, **OTHERS[name](seed)}
    case = CASES[name]
    drive = drive_of(case, seed)
    driven = run(case, drive)
    times, errors = np.array([m.t_s for m in driven.messages]), np.array([m.error for m in driven.messages])
    nees = np.array([m.nees for m in driven.messages])
    row: dict[str, float | str] = {
        "case": name,
        "seed": seed,
        "rms_mm": 1e3 * rms(errors),
        "yaw_deg": math.degrees(float(np.sqrt(np.mean(errors[:, 2] ** 2)))),
        "nees": float(nees.mean()),
        "below_95": float(np.mean(nees < TAIL)),
        "events": " ".join(f"{e.kind}:{e.panel}@{e.t_ns * 1e-9:.1f}" for e in driven.messages[-1].state.events),
    }
    if case.dark:
        row |= of_gaps(case, driven, times, errors, nees)
    elif case.carried:
        row |= of_carried(driven, times, errors, nees)
    elif case.moved:
        row |= of_moved(case, driven, times, nees)
    else:
        fixes = raw_fixes(case, drive)
        row["raw_mm"] = 1e3 * rms(np.array([fix.pose - drive.way.pose(fix.t_s) for fix in fixes]))
        for how in others.STATE:
            row[f"wpilib_{how}_mm"] = 1e3 * rms(others.wpilib_errors(drive, fixes, how, times.tolist()))
    return row


def rms(errors: Floats) -> float:
    """The position's root mean square."""
    return float(np.sqrt(np.mean(np.sum(errors[:, :2] ** 2, axis=1))))


def of_gaps(case: Case, driven: Driven, times: Floats, errors: Floats, nees: Floats) -> dict[str, float]:
    """The error at the end of each gap, and the way within it."""
    row: dict[str, float] = {}
    for number, (begins_s, ends_s) in enumerate(case.dark):
        k = int(np.argmin(abs(times - ends_s)))
        path = driven.drive.way.poses[round(begins_s * 100) : round(ends_s * 100), :2]
        row[f"gap{number}_m"] = float(np.hypot(*np.diff(path, axis=0).T).sum())
        row[f"gap{number}_mm"] = 1e3 * float(np.hypot(*errors[k, :2]))
        row[f"gap{number}_nees"] = float(nees[k])
    return row


def of_carried(driven: Driven, times: Floats, errors: Floats, nees: Floats) -> dict[str, float]:
    """Time from the first view that leaves no choice until the state is right for good, and honesty since."""
    views = [t for t, looks in driven.drive.frames if t > CARRIED_S and any(k.alternate is None for k in looks)]
    first_s = views[0] + PICTURE_LATE_NS * 1e-9
    since = times >= first_s
    right = (np.hypot(*errors[since, :2].T) < RIGHT_M) & (abs(errors[since, 2]) < RIGHT_RAD)
    wrong = np.flatnonzero(~right)
    settled = 0 if not len(wrong) else int(wrong[-1]) + 1
    return {
        "right_s": float(times[since][settled]) - views[0] if settled < len(right) else math.inf,
        "within_3": float(np.mean(nees[times >= views[0] + 0.2] < THREE_DEVIATIONS)),
    }


def of_moved(case: Case, driven: Driven, times: Floats, nees: Floats) -> dict[str, float]:
    """Who was named; the same drive without; and how honest it is from the first view of another panel on."""
    moved, events = driven.drive.moved, driven.messages[-1].state.events
    named = [event.panel for event in events if event.kind == "panel_moved"]
    others = [
        t
        for t, looks in driven.drive.frames
        if t > times[0] and any(k.alternate is None and k.panel != moved for k in looks)
    ]
    assert driven.drive.untouched is not None
    without = run(case, driven.drive.untouched).messages
    return {
        "named": float(moved in named),
        "innocent": float(len({*named} - {moved})),
        "untouched_mm": 1e3 * rms(np.array([m.error for m in without])),
        "within_3": float(np.mean(nees[times >= others[0] + 0.2] < THREE_DEVIATIONS)),
    }


@dataclass(frozen=True, slots=True)
class Asked:
    """A line of what is asked."""

    case: str
    what: str
    value: Callable[[Sequence[Row]], float]
    least: float = -math.inf
    most: float = math.inf


def column(rows: Sequence[Row], *names: str) -> Floats:
    return np.array([float(row[name]) for row in rows for name in names])


def pooled(rows: Sequence[Row], name: str) -> float:
    """The root of the mean square over all drives."""
    return float(np.sqrt(np.mean(column(rows, name) ** 2)))


def tenths(rows: Sequence[Row]) -> Floats:
    """The mean NEES of each tenth of the drives, as they were drawn."""
    return np.array([part.mean() for part in np.array_split(column(rows, "nees"), min(10, len(rows)))])


def docked(rows: Sequence[Row], within_mm: float, within_deg: float) -> float:
    """The share that stands so near its goal, and has not touched the wall."""
    near = (column(rows, "dock_mm") <= within_mm) & (column(rows, "dock_deg") <= within_deg)
    return float(np.mean(near & (column(rows, "touched") == 0)))


def best_of_wpilib(rows: Sequence[Row]) -> Floats:
    """The RMS of each drive, by the better of its documentation's deviations and of ours."""
    return np.minimum(*(column(rows, f"wpilib_{how}_mm") for how in others.STATE))


def share_of_way(rows: Sequence[Row]) -> Floats:
    return column(rows, "gap0_mm", "gap1_mm") / column(rows, "gap0_m", "gap1_m") / 1e3


ASKED = (
    Asked("plain", "position, RMS mm", lambda r: pooled(r, "rms_mm"), most=25),
    Asked("plain", "… over that of raw fixes", lambda r: pooled(r, "rms_mm") / pooled(r, "raw_mm"), most=0.35),
    Asked("plain", "NEES, mean", lambda r: column(r, "nees").mean(), 1, 3.6),
    Asked("plain", "NEES, lowest tenth of the drives", lambda r: tenths(r).min(), least=1),
    Asked("plain", "NEES, highest tenth of the drives", lambda r: tenths(r).max(), most=3.6),
    Asked("plain", "messages with a NEES below 7.81", lambda r: column(r, "below_95").mean(), least=0.95),
    Asked("plain", "drives with an event", lambda r: sum(bool(row["events"]) for row in r), most=0),
    Asked("plain", "WPILib's estimator, RMS mm", lambda r: float(np.sqrt(np.mean(best_of_wpilib(r) ** 2)))),
    Asked(
        "plain",
        "drives in which ours is better than the best of it",
        lambda r: np.mean(column(r, "rms_mm") < best_of_wpilib(r)),
        least=0.95,
    ),
    Asked(
        "batch", "beside the causal optimum, RMS", lambda r: pooled(r, "causal_mm") / pooled(r, "batch_mm"), most=1.25
    ),
    Asked("gaps", "gyro, 5 s: gaps within 3 % of the way", lambda r: np.mean(share_of_way(r) <= 0.03), least=0.9),
    Asked("gaps", "gyro, 5 s: RMS mm", lambda r: math.sqrt(np.mean(column(r, "gap0_mm", "gap1_mm") ** 2)), most=40),
    Asked("gaps_wheels", "wheels, 5 s: NEES", lambda r: column(r, "gap0_nees", "gap1_nees").mean(), most=4),
    Asked("gaps_wheels", "wheels, 5 s: within 3 %", lambda r: np.mean(share_of_way(r) <= 0.03), least=0.5),
    Asked("carried", "carried off: right within 2 s", lambda r: np.mean(column(r, "right_s") <= 2), least=0.9),
    Asked("carried", "carried off: within 3 deviations", lambda r: column(r, "within_3").mean(), least=0.98),
    Asked("moved", "moved panel: named", lambda r: column(r, "named").mean(), least=0.95),
    Asked("moved", "moved panel: innocent ones named", lambda r: column(r, "innocent").sum(), most=0),
    Asked("moved", "moved panel: RMS, × untouched", lambda r: pooled(r, "rms_mm") / pooled(r, "untouched_mm"), most=2),
    Asked("moved_first", "begins at it: innocent ones named", lambda r: column(r, "innocent").sum(), most=0),
    Asked("moved_first", "begins at it: named", lambda r: column(r, "named").mean()),
    Asked("moved_first", "begins at it: within 3 deviations", lambda r: column(r, "within_3").mean()),
    Asked("turns", "a gyro alone: RMS mm", lambda r: pooled(r, "rms_mm")),
    Asked("turns", "a gyro alone: NEES", lambda r: column(r, "nees").mean()),
    Asked("none", "no odometry: RMS mm", lambda r: pooled(r, "rms_mm")),
    Asked("none", "no odometry: NEES", lambda r: column(r, "nees").mean()),
    Asked("clock", "pictures' clock 10 ms off: NEES (must fail)", lambda r: column(r, "nees").mean(), least=3.6),
    Asked("mount", "camera_mount 1° off: RMS mm", lambda r: pooled(r, "rms_mm"), most=25),
    Asked("mount", "camera_mount 1° off: NEES", lambda r: column(r, "nees").mean(), most=3.6),
    *(
        Asked(case, f"{what}: {mm} mm and {deg}°", partial(docked, within_mm=mm, within_deg=deg), least=least)
        for case, what, wide, narrow in (
            ("dock", "docking", 0.99, 0.75),
            ("dock_wheels", "… by wheels alone", 0.99, 0.75),
            ("dock_side", "… side_m 1 % off", 0.95, -math.inf),
            ("dock_mount", "… mount 1° off", -math.inf, -math.inf),
            ("dock_dead", "… dead band 40 mm/s", 0.95, -math.inf),
        )
        for mm, deg, least in ((10, 1.5, wide), (5, 1, narrow))
    ),
)
