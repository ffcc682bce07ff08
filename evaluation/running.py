"""Runs the benchmarks of one folder, all in turn or one with its own arguments.

python -m evaluation.speed                          # all of them
python -m evaluation.speed latency --seconds 10     # one
python -m evaluation.speed --help                   # which there are
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

from evaluation import ROOT


@dataclass(frozen=True)
class Part:
    """A benchmark, with the arguments that it has among all, and what it needs that may not be here."""

    name: str
    arguments: tuple[str, ...] = ()
    module: str | None = None
    path: Path | None = None

    @property
    def missing(self) -> str | None:
        """Returns what of that is not here."""
        if self.module is not None and find_spec(self.module) is None:
            return f"no {self.module} in this environment: see its --help"
        return f"{self.path} is not here" if self.path is not None and not self.path.exists() else None


def run(package: str, parts: Sequence[Part]) -> int:
    """Runs what `python -m PACKAGE …` does with its arguments; returns its exit status."""
    asked = sys.argv[1:]
    if asked and asked[0] in ("-h", "--help"):
        print(overview(package, parts))
        return 0
    if asked:
        if asked[0] not in [part.name for part in parts]:
            names = ", ".join(part.name for part in parts)
            print(f"{package}: no benchmark {asked[0]}; there are: {names}", file=sys.stderr)
            return 2
        return started(package, asked[0], asked[1:])
    failed = [part.name for part in parts if not one_of_all(package, part)]
    if failed:
        print(f"{package}: failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


def one_of_all(package: str, part: Part) -> bool:
    """Runs it where it can be run; returns False where it failed."""
    print(f"== {part.name}: {summary(package, part.name)}", flush=True)
    if part.missing is not None:
        print(f"left out: {part.missing}", flush=True)
        return True
    return started(package, part.name, part.arguments) == 0


def started(package: str, name: str, arguments: Sequence[str]) -> int:
    """In a process of its own, as some set libraries up for themselves."""
    return subprocess.run([sys.executable, "-m", f"{package}.{name}", *arguments], check=False).returncode


def overview(package: str, parts: Sequence[Part]) -> str:
    """The help."""
    width = max(len(part.name) for part in parts)
    lines = [f"  {part.name:{width}}  {summary(package, part.name)}" for part in parts]
    usage = f"usage: python -m {package} [NAME [ARGUMENT…]]\n\nWithout a name: all, in turn. NAME --help tells more.\n"
    return "\n".join([usage, *lines])


def summary(package: str, name: str) -> str:
    """The first line of its docstring, read and not imported: some need what is not here."""
    source = ROOT.joinpath(*package.split("."), f"{name}.py").read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(source)) or "").splitlines()[0]


def end(name: str, faults: Mapping[str, bool]) -> NoReturn:
    """Ends a benchmark: with a line for each fault that holds, and exit status 1 where one does."""
    found = [fault for fault, holds in faults.items() if holds]
    for fault in found:
        print(f"{name}: {fault}", file=sys.stderr)
    sys.exit(1 if found else 0)
