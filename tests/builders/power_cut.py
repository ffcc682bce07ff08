"""A process that is stopped at its n-th system call, and what a disk may hold after a power cut; both by strace."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.builders import ROOT

# All that changes files or names.
CALLS = "openat,write,pwrite64,fsync,fdatasync,ftruncate,link,linkat,rename,renameat,renameat2,unlink,unlinkat,mkdir"
CALLED = re.compile(r"(?:\d+ +)?(\w+)\((.*)\) += \d")
# Imports once. For each line a child stops itself, and then writes what is to be written.
SERVER = """
import os, signal, sys
{imports}
for _ in sys.stdin:
    child = os.fork()
    if not child:
        os.kill(os.getpid(), signal.SIGSTOP)
        {writes}
        os._exit(0)
    os.waitpid(child, os.WUNTRACED)
    print(child, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


class Writer:
    """Python statements that are run again and again, each time in a process of its own, under strace."""

    def __init__(self, process: subprocess.Popen[str], trace: Path) -> None:
        self._process, self._trace = process, trace

    def run(self, *options: str) -> int:
        """Its exit status, -9 where it was killed. What it did is in `trace`, if asked for."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        child = int(self._process.stdout.readline())
        command = ["strace", "-f", "-y", "-s", "0", "-o", str(self._trace), "-e", f"trace={CALLS}", *options]
        with subprocess.Popen([*command, "-p", str(child)], stderr=subprocess.PIPE, text=True) as tracer:
            assert tracer.stderr is not None
            assert "attached" in tracer.stderr.readline()
            os.kill(child, signal.SIGCONT)
            tracer.stderr.read()
        return int(self._process.stdout.readline())

    def stop_at(self, call: str, number: int) -> None:
        """Runs it up to its `number`-th `call`, which is not made."""
        assert self.run("-e", f"inject={call}:signal=KILL:when={number}") == -signal.SIGKILL

    def trace(self) -> list[str]:
        """A run that is not stopped: its calls, one a line."""
        assert self.run() == 0
        return self._trace.read_text(encoding="utf-8").splitlines()


@contextmanager
def writer(imports: str, writes: str, folder: Path, trace: Path) -> Iterator[Writer]:
    """`imports` and `writes`: Python; it runs in `folder`."""
    command = [sys.executable, "-c", SERVER.format(imports=imports, writes=writes)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=folder, env=environment
    ) as process:
        yield Writer(process, trace)
        process.kill()


def each_call(trace: list[str]) -> Iterator[tuple[str, int]]:
    """As `Writer.stop_at` takes it."""
    made = Counter[str]()
    for line in trace:
        if (called := re.match(r"(?:\d+ +)?(\w+)\(", line)) is not None:
            made[called[1]] += 1
            yield called[1], made[called[1]]


class Disk:
    """Contents that one folder may have after a power cut, by a process's trace.

    As a journalling file system promises, and no more: names change in their order, and for good at the latest when
    the folder is synchronised; a file's bytes are there when the file is.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = str(folder)
        self._names = {name: name for name in os.listdir(folder)}  # name → file, known by the first name it had
        self._whole = set(self._names)  # files whose bytes are all on the disk
        self._kept = [dict(self._names)]  # the names that a cut may leave

    def after_cut(self) -> list[dict[str, bool]]:
        """Each way in which the folder may be found: the names, and whether what is behind them is whole."""
        return [{name: file in self._whole for name, file in names.items()} for names in self._kept]

    def apply(self, line: str) -> None:
        """A line of the trace. Calls that failed, and those elsewhere, change nothing."""
        called = CALLED.match(line)
        if called is None:
            return
        call, arguments = called.groups()
        opened = re.match(r"\d+<([^>]*)>", arguments)
        paths = [opened[1]] if opened and call != "openat" else re.findall(r'"([^"]*)"', arguments)
        if call.startswith("fsync") and paths == [self._folder]:
            self._kept = self._kept[-1:]
        named = [os.path.basename(path) for path in paths if os.path.dirname(path) == self._folder]
        if named:
            self._change(call, arguments, *named)

    def _change(self, call: str, arguments: str, name: str, other: str = "") -> None:
        names = self._names
        if call in ("fsync", "fdatasync"):
            self._whole.add(names[name])
        elif call in ("write", "pwrite64", "ftruncate") or "O_TRUNC" in arguments:
            self._whole.discard(names[name])
        elif "O_CREAT" in arguments:
            names[name] = name
        elif call.startswith("link"):
            names[other] = names[name]
        elif call.startswith("rename"):
            names[other] = names.pop(name)
        elif call.startswith("unlink"):
            del names[name]
        if names != self._kept[-1]:
            self._kept.append(dict(names))
