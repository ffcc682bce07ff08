"""Results: a folder of rows that grows run by run, its tables, its page, and plots as the paper's Figure 12.

settings.json says what was asked for, units.jsonl holds a line for each unit that is finished.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

import ledpi
from ledpi.core.errors import ConfigError, install_command, raising
from ledpi.workshop.evaluate.table import PAPER_ANGLES_AT_M, PLAIN, TableRow, write_csv

if TYPE_CHECKING:
    from matplotlib.axes import Axes


LABELS = {
    "ledpi": "ledpi",
    "oracle": "true corners given",
    "uemura": "uemura (the paper's method)",
    "likelihood": "likelihood, one frame",
    "stream_4": "likelihood, 4th frame of a stream",
    "stream_12": "likelihood, 12th frame",
    "stream_all": "likelihood, every frame of a stream",
    "aruco": "printed ArUco, OpenCV",
    "apriltag": "printed AprilTag",
}
_STYLES = {
    "uemura": ("tab:brown", "v:"),
    "likelihood": ("tab:blue", "o-"),
    "stream_4": ("tab:cyan", "s-"),
    "stream_12": ("tab:green", "D-"),
    "aruco": ("tab:red", "^--"),
    "apriltag": ("tab:orange", "x--"),
}
# All that the paper prints of its Figure 12 as numbers, in its section 5.3: (from, to, per cent).
_PAPER_DISTANCE, _PAPER_ANGLE = (0.6, 0.8, 43.0), (-20.0, 20.0, 40.0)


def has_matplotlib() -> bool:
    """Tells whether plots can be drawn (an optional extra)."""
    return importlib.util.find_spec("matplotlib") is not None


def draw_rates(rows: Sequence[TableRow], path: Path) -> None:
    """Rate against distance and against angle, of rows of one exposure and tone, as one picture."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    plain = [r for r in rows if r.case == PLAIN and r.distance_m is not None and r.rate is not None]
    figure = Figure(figsize=(13, 5), layout="constrained")
    FigureCanvasAgg(figure)
    by_distance, by_angle = figure.subplots(1, 2)
    _plot(by_distance, [r for r in plain if r.angle_deg == 0], "distance_m")
    _quote(by_distance, _PAPER_DISTANCE, "the paper:\n“over 43 %”")
    by_distance.set_xscale("log")
    shown = sorted({r.distance_m for r in plain if r.angle_deg == 0 and r.distance_m is not None})
    by_distance.set_xticks(shown, [f"{d:g}" for d in shown], fontsize=8, rotation=45)
    by_distance.set_xticks([], minor=True)
    by_distance.set_xlabel("distance, m")
    _plot(by_angle, [r for r in plain if r.distance_m == PAPER_ANGLES_AT_M], "angle_deg")
    _quote(by_angle, _PAPER_ANGLE, "the paper: “above 40 %”")
    by_angle.set_xlabel(f"angle to the line of sight at {PAPER_ANGLES_AT_M:g} m, degrees")
    handles, labels = by_distance.get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=9, loc="outside lower center", ncols=len(labels), frameon=False)
    figure.savefig(path, dpi=110, metadata={"Software": None})


def _plot(axes: Axes, rows: Sequence[TableRow], across: str) -> None:
    """One line a method, with 95 % intervals."""
    for method, (colour, style) in _STYLES.items():
        own = sorted((r for r in rows if r.method == method), key=lambda r: float(getattr(r, across)))
        if own:
            rates = [100 * (r.rate or 0) for r in own]
            down = [rate - 100 * (r.rate_low or 0) for rate, r in zip(rates, own, strict=True)]
            up = [100 * (r.rate_high or 0) - rate for rate, r in zip(rates, own, strict=True)]
            at = [getattr(r, across) for r in own]
            axes.errorbar(at, rates, (down, up), fmt=style, color=colour, label=LABELS[method], capsize=2, lw=1.2, ms=4)
    axes.set_ylim(-3, 103)
    axes.set_ylabel("recognised, %")
    axes.grid(alpha=0.3)


def _quote(axes: Axes, quoted: tuple[float, float, float], text: str) -> None:
    first, last, percent = quoted
    axes.plot([first, last], [percent, percent], color="black", lw=3)
    axes.annotate(
        text,
        ((first * last) ** 0.5 if first > 0 else (first + last) / 2, percent),
        (0, -4),
        fontsize=9,
        textcoords="offset points",
        ha="center",
        va="top",
    )


SETTINGS_FILE, UNITS_FILE = "settings.json", "units.jsonl"
SOURCES = (".py", ".c", ".h")

CSV_FILE, PAGE_FILE = "results.csv", "evaluation.md"
_MAX_FALSE_LISTED = 20  # false IDs that are listed one by one
_MAX_REASONS = 4
Commands = Callable[[TableRow], Sequence[str]]  # that give the table again which a row is in
Cell = Callable[[TableRow], str]  # of a row, in a table


@cache
def code_version(*further: Path) -> str:
    """Returns what results depend on: the sources of ledpi and of `further` packages; numpy, OpenCV."""
    digests = [source_digest(package)[:12] for package in (Path(ledpi.__file__).parent, *further)]
    return f"{'+'.join(digests)}, numpy {np.__version__} OpenCV {cv2.__version__}"


def source_digest(package: Path) -> str:
    """SHA-256 of a package's sources, those of its compiled loops too, and of their names; in hexadecimal."""
    digest = hashlib.sha256()
    for path in sorted(path for path in package.rglob("*") if path.suffix in SOURCES):
        digest.update(str(path.relative_to(package)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


class ResultsFolder:
    """Raises ConfigError where the folder is of another run, holds something else, or cannot be used."""

    def __init__(self, path: Path, settings: dict[str, Any]) -> None:
        self.path = path
        self.finished: dict[str, dict[str, Any]] = {}  # records by their unit's key
        with raising(f"--out {path}: cannot be used", ConfigError, OSError):
            path.mkdir(parents=True, exist_ok=True)
            self._claim(json.loads(json.dumps(settings)))  # as it comes back from the file
            self._read_units()

    def add(self, record: dict[str, Any]) -> None:
        """Keeps a finished unit's record, also when the run ends with the next breath."""
        with (self.path / UNITS_FILE).open("a", encoding="utf-8") as file:
            file.write(json.dumps(record) + "\n")
        self.finished[record["unit"]] = record

    def _claim(self, settings: dict[str, Any]) -> None:
        path = self.path / SETTINGS_FILE
        if not path.exists():
            if any(self.path.iterdir()):
                raise ConfigError(f"--out {self.path}: holds other things; must be new, empty, or of a run like this")
            path.write_text(json.dumps(settings, indent=1) + "\n", encoding="utf-8")
            return
        try:
            there = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            raise ConfigError(f"{path}: is no JSON; remove the folder, or give another --out") from None
        if not isinstance(there, dict):
            raise ConfigError(f"{path}: must be settings; remove the folder, or give another --out")
        if there.keys() == settings.keys() and [*self.path.iterdir()] == [path]:  # it ended before its first unit
            path.write_text(json.dumps(settings, indent=1) + "\n", encoding="utf-8")
            return
        for key in settings:
            if there.get(key) != settings[key]:
                raise ConfigError(
                    f"{path}: {key}: the results here are of {there.get(key)!r}, asked for is {settings[key]!r}; "
                    "give another --out, or remove the folder"
                )

    def _read_units(self) -> None:
        path = self.path / UNITS_FILE
        if not path.exists():
            return
        content = path.read_bytes()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):  # the run was broken off in the middle of this line
            os.truncate(path, whole)
        for number, line in enumerate(content[:whole].splitlines(), start=1):
            try:
                record = json.loads(line)
                self.finished[record["unit"]] = record
            except (ValueError, KeyError, TypeError):
                raise ConfigError(f"{path}: line {number}: is no unit's record; remove that line") from None


def recording_section(rows: Sequence[TableRow]) -> list[str]:
    """The title and the tables of recordings."""
    return ["From recordings", *recognised_tables(rows)]


def write_results(
    folder: Path,
    rows: Sequence[TableRow],
    intro: str,
    commands: Commands,
    section: Callable[[Sequence[TableRow]], list[str]] = recording_section,
) -> list[str]:
    """results.csv, evaluation.md, and a picture for each exposure and tone. Returns notes on what is left out.

    `section`: what the rows of one suite are told in, its title first.
    """
    write_csv(folder / CSV_FILE, rows)
    notes = []
    if not has_matplotlib():
        notes.append(f"no plots: matplotlib is not installed: {install_command('evaluate')}")
    parts = ["# ledpi evaluate", intro]
    for group in groups(rows, lambda row: (row.exposure_us, row.transfer)):
        of = f"{group[0].exposure_us:g} µs, {group[0].transfer}"
        plain = [row for row in group if row.case == PLAIN and row.distance_m is not None]
        if plain and has_matplotlib():
            name = f"rates-{group[0].exposure_us:g}us-{group[0].transfer}.png"
            draw_rates(plain, folder / name)
            parts += [f"## As the paper's Figure 12: {of}", f"![Recognition rate over distance and angle]({name})"]
        for own in groups(group, lambda row: row.suite):
            title, *tables = section(own)
            parts += [f"## {title}: {of}", *tables, "\n".join(["Again:", "", "```sh", *commands(own[0]), "```"])]
    (folder / PAGE_FILE).write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    return notes


def rate(row: TableRow) -> str:
    """The share that was recognised, its interval, and the false IDs."""
    if row.rate is None or row.rate_low is None or row.rate_high is None:
        return "–"
    false = f", **{row.false_ids} false**" if row.false_ids else ""
    return f"{100 * row.rate:.4g} % ({100 * row.rate_low:.1f}–{100 * row.rate_high:.1f}){false}"


def summary(rows: Sequence[TableRow], result: Cell = rate) -> str:
    """A line a row, for a terminal."""
    lines = []
    for row in rows:
        where = ", ".join(part for part in (row.suite, _where(row), f"{row.exposure_us:g} µs", row.transfer) if part)
        lines.append(f"{where:60} {row.method:10} {result(row)}".replace("**", ""))
    return "\n".join(lines)


def recognised_tables(rows: Sequence[TableRow]) -> list[str]:
    """Tables of what was recognised, how exactly, why not, and of what else was read."""
    tables = [
        "Recognised, with the 95 % interval:",
        pivot(rows, rate),
        "Medians: corners, position, angle, decode time:",
        pivot(rows, _errors),
    ]
    if any(row.missed for row in rows):
        tables += ["Why panels were missed:", pivot(rows, _reasons)]
    return tables + false_ids(rows)


def false_ids(rows: Sequence[TableRow]) -> list[str]:
    """A list of the first; none where there are none."""
    false = [f"{_where(row)}, {LABELS[row.method]}: {text}" for row in rows for text in row.false]
    listed = [f"- {text}" for text in false[:_MAX_FALSE_LISTED]]
    if len(false) > _MAX_FALSE_LISTED:
        listed.append(f"- … and {len(false) - _MAX_FALSE_LISTED} more")
    return ["\n".join(["False IDs:", "", *listed])] if listed else []


def pivot(rows: Sequence[TableRow], cell: Cell) -> str:
    """A row for each place or case, a column for each method."""
    methods = [m for m in LABELS if any(row.method == m for row in rows)]
    lines = [["", *(LABELS[m] for m in methods)], ["---"] * (len(methods) + 1)]
    for place in groups(rows, _where):
        cells = {row.method: cell(row) for row in place}
        lines.append([_where(place[0]), *(cells.get(m, "") for m in methods)])
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _where(row: TableRow) -> str:
    case = [] if row.case == PLAIN else [row.case]
    place = [] if row.distance_m is None else [f"{row.distance_m:g} m", f"{row.angle_deg:g}°"]
    return ", ".join([*case, *place])


def _errors(row: TableRow) -> str:
    values = [(row.corner_px, "px"), (row.position_percent, "%"), (row.angle_error_deg, "°"), (row.decode_ms, "ms")]
    return ", ".join("–" if value is None else f"{value:.2g} {unit}".replace(" °", "°") for value, unit in values)


def _reasons(row: TableRow) -> str:
    told = [f"{count} {why}" for why, count in row.missed[:_MAX_REASONS]]
    left = sum(count for _, count in row.missed[_MAX_REASONS:])
    return ", ".join(told + ([f"{left} other"] if left else []))


def groups(rows: Iterable[TableRow], key: Callable[[TableRow], object]) -> list[list[TableRow]]:
    """Rows of one key together, keys in the order of their first rows."""
    by_key: dict[object, list[TableRow]] = {}
    for row in rows:
        by_key.setdefault(key(row), []).append(row)
    return list(by_key.values())
