"""The page of a run: tables as Markdown, the plots beside it, and under each table the command that gives it again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from ledpi.core.wording import install_command
from ledpi.tools.evaluate.conditions import PLAIN
from ledpi.tools.evaluate.plots import LABELS, draw_rates, has_matplotlib
from ledpi.tools.evaluate.table import TableRow, wilson, write_csv

CSV_FILE, PAGE_FILE = "results.csv", "evaluation.md"
_MAX_FALSE_LISTED = 20  # false IDs that are listed one by one
_MAX_REASONS = 4
_TITLES = {
    "paper": "The paper's experiment",
    "beyond": "Beyond the paper",
    "robustness": "Robustness",
    "decoys": "Decoys: nothing may be reported",
    "wild": "Wild: everything varied at once",
    "recording": "From recordings",
}

Commands = Callable[[TableRow], Sequence[str]]  # that give the table again which a row is in


def write_results(folder: Path, rows: Sequence[TableRow], intro: str, commands: Commands) -> list[str]:
    """results.csv, evaluation.md, and a picture for each exposure and tone. Returns notes on what is left out."""
    write_csv(folder / CSV_FILE, rows)
    notes = []
    if not has_matplotlib():
        notes.append(f"no plots: matplotlib is not installed: {install_command('evaluate')}")
    parts = ["# ledpi evaluate", intro]
    for group in _groups(rows, lambda row: (row.exposure_us, row.transfer)):
        of = f"{group[0].exposure_us:g} µs, {group[0].transfer}"
        plain = [row for row in group if row.case == PLAIN and row.distance_m is not None]
        if plain and has_matplotlib():
            name = f"rates-{group[0].exposure_us:g}us-{group[0].transfer}.png"
            draw_rates(plain, folder / name)
            parts += [f"## As the paper's Figure 12: {of}", f"![Recognition rate over distance and angle]({name})"]
        for own in _groups(group, lambda row: row.suite):
            parts += [f"## {_TITLES[own[0].suite]}: {of}", *_tables(own)]
            parts.append("\n".join(["Again:", "", "```sh", *commands(own[0]), "```"]))
    (folder / PAGE_FILE).write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    return notes


def summary(rows: Sequence[TableRow]) -> str:
    """A line a row, for a terminal."""
    lines = []
    for row in rows:
        where = ", ".join(part for part in (row.suite, _where(row), f"{row.exposure_us:g} µs", row.transfer) if part)
        result = _false_share(row) if row.suite == "decoys" else _rate(row)
        lines.append(f"{where:60} {row.method:10} {result}".replace("**", ""))
    return "\n".join(lines)


def _tables(rows: Sequence[TableRow]) -> list[str]:
    false = [f"{_where(row)}, {LABELS[row.method]}: {text}" for row in rows for text in row.false]
    listed = [f"- {text}" for text in false[:_MAX_FALSE_LISTED]]
    if len(false) > _MAX_FALSE_LISTED:
        listed.append(f"- … and {len(false) - _MAX_FALSE_LISTED} more")
    told = ["\n".join(["False IDs:", "", *listed])] if listed else []
    if rows[0].suite == "decoys":
        return [_pivot([*rows, *_totals(rows)], _false_share), *told]
    tables = [
        "Recognised, with the 95 % interval:",
        _pivot(rows, _rate),
        "Medians: corners, position, angle, decode time:",
        _pivot(rows, _errors),
    ]
    if any(row.missed for row in rows):
        tables += ["Why panels were missed:", _pivot(rows, _reasons)]
    return tables + told


def _totals(rows: Sequence[TableRow]) -> list[TableRow]:
    """One a method, over all kinds of decoys."""
    return [
        replace(
            own[0],
            case="all",
            frames=sum(row.frames for row in own),
            trials=sum(row.trials for row in own),
            false_ids=sum(row.false_ids for row in own),
        )
        for own in _groups(rows, lambda row: row.method)
    ]


def _pivot(rows: Sequence[TableRow], cell: Callable[[TableRow], str]) -> str:
    """A row for each place or case, a column for each method."""
    methods = [m for m in LABELS if any(row.method == m for row in rows)]
    lines = [["", *(LABELS[m] for m in methods)], ["---"] * (len(methods) + 1)]
    for place in _groups(rows, _where):
        cells = {row.method: cell(row) for row in place}
        lines.append([_where(place[0]), *(cells.get(m, "") for m in methods)])
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _where(row: TableRow) -> str:
    case = [] if row.case == PLAIN else [row.case]
    place = [] if row.distance_m is None else [f"{row.distance_m:g} m", f"{row.angle_deg:g}°"]
    return ", ".join([*case, *place])


def _rate(row: TableRow) -> str:
    if row.rate is None or row.rate_low is None or row.rate_high is None:
        return "–"
    false = f", **{row.false_ids} false**" if row.false_ids else ""
    return f"{100 * row.rate:.4g} % ({100 * row.rate_low:.1f}–{100 * row.rate_high:.1f}){false}"


def _false_share(row: TableRow) -> str:
    """As if the frames of a take were one: the interval's upper end is no promise that they are not."""
    most = 100 * wilson(min(row.false_ids, row.trials), row.trials)[1]
    count = f"**{row.false_ids} false**" if row.false_ids else "0"
    return f"{count} in {row.frames} frames of {row.trials} scenes (below {most:.2g} % of scenes)"


def _errors(row: TableRow) -> str:
    values = [
        (row.corner_px, "px"),
        (row.position_percent, "%"),
        (row.angle_error_deg, "°"),
        (row.decode_ms, "ms"),
    ]
    return ", ".join("–" if value is None else f"{value:.2g} {unit}".replace(" °", "°") for value, unit in values)


def _reasons(row: TableRow) -> str:
    told = [f"{count} {why}" for why, count in row.missed[:_MAX_REASONS]]
    left = sum(count for _, count in row.missed[_MAX_REASONS:])
    return ", ".join(told + ([f"{left} other"] if left else []))


def _groups(rows: Iterable[TableRow], key: Callable[[TableRow], object]) -> list[list[TableRow]]:
    """Rows of one key together, keys in the order of their first rows."""
    by_key: dict[object, list[TableRow]] = {}
    for row in rows:
        by_key.setdefault(key(row), []).append(row)
    return list(by_key.values())
