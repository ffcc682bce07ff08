"""Counts the instructions of stretches of a Python program, which marks them itself: on x86-64 and on 64-bit ARM.

A mark is a system call that does nothing. On x86-64 valgrind's callgrind counts from one to the next; 64-bit ARM is
emulated by qemu-user, for which marks.c counts. What else the machine does changes nothing.
"""

from __future__ import annotations

import os
import pickle
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from evaluation import ROOT

MARK = -20815  # a process group that cannot be; marks.c waits for it


def mark() -> None:
    """Begins a stretch, or ends it."""
    with suppress(OSError):
        os.getpgid(MARK)


@contextmanager
def program_of(module: str, frames: object) -> Iterator[list[str]]:
    """The words after `python` of a benchmark that decodes what `pictures` loads, given as its option --pictures."""
    with tempfile.TemporaryDirectory() as folder:
        pictures = Path(folder) / "frames"
        pictures.write_bytes(pickle.dumps(frames))
        yield ["-m", module, "--pictures", str(pictures)]


def on_x86_64(program: Sequence[str]) -> list[int]:
    """Instructions of each stretch of `python PROGRAM…`, in their order. Raises SystemExit where it fails."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "callgrind"
        options = ["--tool=callgrind", f"--callgrind-out-file={out}", "--dump-before=getpgid"]
        _run(["valgrind", *options, sys.executable, *program], {})
        parts = [out.with_suffix(f".{number + 1}") for number in range(len(list(Path(folder).iterdir())) - 1)]
        sums = [re.search(r"^totals: (\d+)", part.read_text(encoding="utf-8"), re.MULTILINE) for part in parts]
    return [int(found[1]) for found in sums[1::2] if found]  # what is between two stretches is left out


def on_aarch64(wheel: Path, program: Sequence[str]) -> list[int]:
    """The same of a wheel for 64-bit ARM."""
    with tempfile.TemporaryDirectory() as folder:
        plugin = Path(folder) / "marks.so"
        source = Path(__file__).with_name("marks.c")
        subprocess.run(["gcc", "-O2", "-fPIC", "-shared", "-o", plugin, source], check=True)
        emulated = [str(ROOT / "scripts" / "emulated-aarch64"), "--python", str(wheel)]
        said = _run([*emulated, *program], {"QEMU_PLUGIN": f"file={plugin}"})
    counts = [int(count) for count in re.findall(r"^mark (\d+)$", said, re.MULTILINE)]
    return [end - begin for begin, end in zip(counts[::2], counts[1::2], strict=True)]


def _run(command: Sequence[str], variables: dict[str, str]) -> str:
    """Returns what it writes to stderr."""
    environment = os.environ | {"PYTHONHASHSEED": "0", "OPENBLAS_NUM_THREADS": "1"} | variables
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{command[0]}: {done.stderr[-2000:]}")
    return done.stderr
