"""Plants single faults in ledpi, one at a time in a copy of the tree, and says which of them the tests notice.

The faults are the same each time while the code stays: of all that could be planted those whose names have the
smallest hash, so that a change elsewhere leaves them as they are. Python's meet the tests that run their lines; C's
meet the tests of what is compiled. A fault that nobody notices is printed with its place: a gap in the tests, or a
change that changes nothing.

    .venv/bin/python scripts/mutants.py                       200 faults in Python, 60 in C: some hours
    .venv/bin/python scripts/mutants.py --python 20 --c 0     fewer
    .venv/bin/python scripts/mutants.py --only pose           of files whose path holds that
    .venv/bin/python scripts/mutants.py --all                 against every test, not the quick ones alone

Needs `coverage` (pip install coverage) and what scripts/test needs. Exit status 0: it is a measurement.
"""

from __future__ import annotations

import argparse
import ast
import copy
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
LEFT_OUT = ("__pycache__", ".git", ".venv*", ".cache", ".mypy_cache", ".pytest_cache", ".hypothesis", "demo-out")
C_TESTS = (*(f"tests/unit/{name}" for name in ("core", "pose", "decode", "pipeline")), "tests/scenarios")
LIMIT_S = 900  # of one fault's tests; one that makes them hang is noticed, too
COVERED = "import coverage\n\ncoverage.process_startup()\n"
CONTEXTS = """import coverage
import pytest


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    coverage.Coverage.current().switch_context(f"{item.nodeid} (setup)")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_call(item):
    coverage.Coverage.current().switch_context(item.nodeid)
"""

_Swap = dict[type[ast.AST], type[ast.AST]]
COMPARISONS: _Swap = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq}
COMPARISONS |= {ast.NotEq: ast.Eq, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is}
ARITHMETIC: _Swap = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult}
ARITHMETIC |= {ast.Mod: ast.Mult, ast.Pow: ast.Mult, ast.BitAnd: ast.BitOr}
C_SWAPS = [("+", "-"), ("-", "+"), ("*", "/"), ("/", "*"), ("<", "<="), (">", ">="), ("<=", "<"), (">=", ">")]
C_SWAPS += [("==", "!="), ("!=", "=="), ("&&", "||"), ("||", "&&"), ("+=", "-=")]


@dataclass(frozen=True)
class Fault:
    """One place of a file, and how the file reads with that place changed."""

    path: Path  # below the root
    line: int
    kind: str
    planted: Callable[[], str]

    def __str__(self) -> str:
        return f"{self.path}:{self.line} {self.kind}"


def main() -> None:
    """Plants them, and prints what became of each."""
    arguments = _arguments()
    if arguments.python and not find_spec("coverage"):
        sys.exit("mutants: faults in Python need coverage, which says what runs which line: pip install coverage")
    sources = sorted(path.relative_to(ROOT) for ending in ("py", "c") for path in (ROOT / "ledpi").rglob(f"*.{ending}"))
    sources = [path for path in sources if arguments.only in str(path) and "sources" not in path.parts]
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "ledpi"
        shutil.copytree(ROOT, tree, symlinks=True, ignore=shutil.ignore_patterns(*LEFT_OUT))
        tests = Tests(tree, every=arguments.all)
        for ending, most in (("py", arguments.python), ("c", arguments.c)):
            faults = drawn((path for path in sources if path.suffix == f".{ending}"), most)
            if ending == "py" and faults:
                tests.map_lines()
            noticed = [_planted(fault, tree, tests) for fault in faults]
            print(f"{ending}: {sum(noticed)} of {len(noticed)} noticed", flush=True)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", type=int, default=200, metavar="N", help="faults in Python")
    parser.add_argument("--c", type=int, default=60, metavar="N", help="faults in C")
    parser.add_argument("--only", default="", metavar="TEXT", help="of files whose path holds it")
    parser.add_argument("--all", action="store_true", help="against every test, the slow ones too")
    return parser.parse_args()


def _planted(fault: Fault, tree: Path, tests: Tests) -> bool:
    """Asks whether any test notices it; the file is as before afterwards."""
    path = tree / fault.path
    right = path.read_text(encoding="utf-8")
    path.write_text(fault.planted(), encoding="utf-8")
    try:
        noticed = tests.notice_c() if path.suffix == ".c" else tests.notice(fault)
    finally:
        path.write_text(right, encoding="utf-8")
    print(f"{'noticed ' if noticed else 'MISSED  '}{fault}", flush=True)
    return noticed


def drawn(paths: Iterable[Path], most: int) -> list[Fault]:
    """Draws so many faults, evenly over all that can be planted, and the same ones each time."""
    named: dict[str, Fault] = {}
    for path in paths:
        text = (ROOT / path).read_text(encoding="utf-8")
        lines = text.splitlines()
        for fault in _python_faults(path, text) if path.suffix == ".py" else _c_faults(path, text):
            name = f"{path} {fault.kind} {lines[fault.line - 1].strip()}"
            while name in named:
                name += " again"
            named[name] = fault
    hashed = sorted(named, key=lambda name: sha256(name.encode()).hexdigest())
    return [named[name] for name in hashed[:most]]


def _python_faults(path: Path, text: str) -> Iterator[Fault]:
    """Yields each; annotations and texts have none."""
    tree = ast.parse(text)
    notes = [getattr(node, name, None) for node in ast.walk(tree) for name in ("annotation", "returns")]
    passed_over = {id(node) for note in notes if note is not None for node in ast.walk(note)}
    for place, node in enumerate(ast.walk(tree)):
        kind = None if id(node) in passed_over else _kind(node)
        if kind is not None:
            yield Fault(path, getattr(node, "lineno", 1), kind, partial(_with_fault, tree, place))


def _kind(node: ast.AST) -> str | None:
    match node:
        case ast.Compare(ops=[first, *_]) if type(first) in COMPARISONS:
            return "comparison"
        case ast.BinOp() if type(node.op) in ARITHMETIC:
            return "arithmetic"
        case ast.BoolOp():
            return "and/or"
        case ast.If() | ast.While() | ast.IfExp():
            return "condition"
        case ast.Constant(value=bool() | int() | float()):
            return "constant"
        case ast.Expr(value=ast.Call()):
            return "call"
        case ast.Return(value=ast.expr()):
            return "return"
    return None


def _with_fault(tree: ast.Module, place: int) -> str:
    changed = copy.deepcopy(tree)
    node = list(ast.walk(changed))[place]
    match node:
        case ast.Compare():
            node.ops[0] = COMPARISONS[type(node.ops[0])]()  # type: ignore[assignment]
        case ast.BinOp():
            node.op = ARITHMETIC[type(node.op)]()  # type: ignore[assignment]
        case ast.BoolOp():
            node.op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        case ast.If() | ast.While() | ast.IfExp():
            node.test = ast.UnaryOp(ast.Not(), node.test)
        case ast.Constant(value=bool() as value):
            node.value = not value
        case ast.Constant(value=int() | float() as number):
            node.value = number + 1 if isinstance(number, int) else number * 1.5 + 0.01
        case ast.Expr():
            node.value = ast.Constant(None)
        case ast.Return():
            node.value = ast.Constant(None)
    return ast.unparse(ast.fix_missing_locations(changed))


def _c_faults(path: Path, text: str) -> Iterator[Fault]:
    lines = text.splitlines(keepends=True)
    for number, line in enumerate(lines):
        code = re.sub(r"//.*|/\*.*", "", line)
        if code.lstrip().startswith(("*", "#")):
            continue
        for old, new in C_SWAPS:
            if f" {old} " in code:
                changed = [*lines[:number], line.replace(f" {old} ", f" {new} ", 1), *lines[number + 1 :]]
                yield Fault(path, number + 1, f"{old} → {new}", partial("".join, changed))


class Tests:
    """The tests of a copy of the tree."""

    def __init__(self, tree: Path, *, every: bool) -> None:
        self._tree = tree
        quick = ["-m", "not slow and not nightly and not alone", "--first-and-last"]
        self._chosen = ["-m", "not alone"] if every else quick
        self._of_line: dict[tuple[str, int], set[str]] = {}
        self._seconds: dict[str, float] = {}
        self._environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")} | {
            "OPENBLAS_NUM_THREADS": "1",
            "PYTHONPATH": str(tree),
        }

    def map_lines(self) -> None:
        """Runs the tests once, and keeps which ran which lines, in processes they start too, and how long each took."""
        # Each context of coverage is a test and its phase, as pytest tells them to the processes that tests start.
        rules, told = self._tree / ".coveragerc", "${PYTEST_CURRENT_TEST-}"
        within = f"source = ledpi\nparallel = true\ncontext = {told}\ndata_file = {self._tree}/.coverage\n"
        rules.write_text(f"[run]\n{within}", encoding="utf-8")
        for name, text in (("sitecustomize", COVERED), ("contexts", CONTEXTS)):
            (self._tree / f"{name}.py").write_text(text, encoding="utf-8")
        self._environment["COVERAGE_PROCESS_START"] = str(rules)
        reported = ["--junitxml=times.xml", "-o", "junit_family=xunit1"]
        self._run(["-m", "pytest", "-p", "contexts", *reported, *self._chosen], limit_s=None)
        del self._environment["COVERAGE_PROCESS_START"]
        self._run(["-m", "coverage", "combine", "--quiet", f"--rcfile={rules}"])
        self.read_map()

    def read_map(self) -> None:
        """Reads what `map_lines` has measured."""
        import coverage

        cases = list(ElementTree.parse(self._tree / "times.xml").iter("testcase"))
        for case in cases:
            self._seconds[_name(case)] = self._seconds.get(_name(case), 0.0) + float(case.get("time", 0.0))
        # One that fails without a fault notices none.
        for case in cases:
            if case.find("failure") is not None or case.find("error") is not None:
                self._seconds.pop(_name(case), None)
        data = coverage.CoverageData(str(self._tree / ".coverage"))
        data.read()
        tests_of = {context: self._named(context.strip("|")) for context in data.measured_contexts()}
        for file in data.measured_files():
            for line, contexts in data.contexts_by_lineno(file).items():
                of_line = {test for context in contexts for test in tests_of[context]}
                self._of_line[(str(Path(file).relative_to(self._tree)), line)] = of_line

    def _named(self, context: str) -> list[str]:
        """Returns the tests it names: what one's fixtures run, others of its file may judge."""
        test = context.partition(" (")[0].partition("[")[0]
        whole = test.partition("::")[0] if context.endswith("(setup)") else test
        return [name for name in self._seconds if name == test or name.startswith(f"{whole}::")]

    def notice(self, fault: Fault) -> bool:
        """Asks the tests that run its line, the quickest first; nobody notices it where there are none."""
        tests = sorted(self._of_line.get((str(fault.path), fault.line), set()), key=self._seconds.__getitem__)
        if not tests:
            return False
        return self._run(["-m", "pytest", "-x", "-p", "no:cacheprovider", *self._chosen, *tests]) not in (0, 5)

    def notice_c(self) -> bool:
        """Compiles what changed, and asks the tests of what is compiled."""
        if self._run(["setup.py", "build_ext", "--inplace"]):
            return True
        return self._run(["-m", "pytest", "-x", "-p", "no:cacheprovider", *self._chosen, *C_TESTS]) not in (0, 5)

    def _run(self, command: list[str], limit_s: float | None = LIMIT_S) -> int:
        within: dict[str, Any] = {"cwd": self._tree, "env": self._environment, "capture_output": True}
        try:
            return subprocess.run([sys.executable, *command], timeout=limit_s, check=False, **within).returncode
        except subprocess.TimeoutExpired:
            return 1


def _name(case: ElementTree.Element) -> str:
    return f"{case.get('file')}::{str(case.get('name')).partition('[')[0]}"


if __name__ == "__main__":
    main()
