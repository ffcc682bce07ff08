"""Titles of the suites, and the table of decoys, in which nothing may be reported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ledpi.workshop.evaluate.page import false_ids, groups, pivot, rate, recognised_tables
from ledpi.workshop.evaluate.table import TableRow, wilson

_TITLES = {
    "paper": "The paper's experiment",
    "beyond": "Beyond the paper",
    "robustness": "Robustness",
    "decoys": "Decoys: nothing may be reported",
    "wild": "Wild: everything varied at once",
}


def section(rows: Sequence[TableRow]) -> list[str]:
    """The title and the tables of the rows of one suite."""
    title = _TITLES[rows[0].suite]
    if rows[0].suite != "decoys":
        return [title, *recognised_tables(rows)]
    return [title, pivot([*rows, *_totals(rows)], result), *false_ids(rows)]


def result(row: TableRow) -> str:
    """The rate; of decoys the false IDs, as if the frames of a take were one: the interval is no promise of less."""
    if row.suite != "decoys":
        return rate(row)
    most = 100 * wilson(min(row.false_ids, row.trials), row.trials)[1]
    count = f"**{row.false_ids} false**" if row.false_ids else "0"
    return f"{count} in {row.frames} frames of {row.trials} scenes (below {most:.2g} % of scenes)"


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
        for own in groups(rows, lambda row: row.method)
    ]
