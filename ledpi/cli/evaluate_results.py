"""Tables and lines in which `ledpi evaluate` shows its results."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ledpi.tools.evaluate.page import Commands
    from ledpi.tools.evaluate.table import TableRow


def show(out: Path, rows: list[TableRow], intro: str, commands: Commands) -> None:
    """Writes the results, and says in short on standard output what they are."""
    from ledpi.tools.evaluate.page import PAGE_FILE, summary, write_results

    for note in write_results(out, rows, intro, commands):
        print(f"ledpi: {note}", file=sys.stderr)
    print(summary(rows))
    print(f"The tables and the plots: {out / PAGE_FILE}")
