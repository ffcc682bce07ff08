"""Programs for an ATmega328P at 16 MHz in the emulator simavr: run, talked to, and their pins' edges written down."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.builders import ROOT
from tests.builders.waiting import limit_s

SOURCE = Path(__file__).with_name("avr_trace.c")
CLOCK_HZ = 16_000_000
_STEPS_PER_CYCLE = 625  # of the trace's 100 ps

_TOOLS = {"make": "make", "gcc": "gcc", "avr-gcc": "gcc-avr", "avr-objcopy": "binutils-avr"}  # and Debian's packages
_FILES = {"/usr/lib/avr/include/avr/io.h": "avr-libc", "/usr/include/simavr/sim_avr.h": "libsimavr-dev"}
MISSING = [package for tool, package in _TOOLS.items() if shutil.which(tool) is None]
MISSING += [package for path, package in _FILES.items() if not Path(path).exists()]

needs_simavr = pytest.mark.skipif(bool(MISSING), reason=f"not installed: {', '.join(MISSING)}")

Cycles = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class PinTrace:
    """The doings of a program from its reset on."""

    edges: dict[str, Cycles]  # by pin, as PB1: the clock cycles at which it changed; it is low before the first
    end: int  # cycle at which the emulator was stopped
    said: bytes  # on the serial line

    def is_high(self, pin: str, cycle: int) -> bool:
        """The pin's level just after a clock cycle."""
        return bool(np.searchsorted(self.edges[pin], cycle, side="right") % 2)


def build_with_make(folder: Path) -> Path:
    """Runs `make` there; the one .hex that it makes."""
    subprocess.run(["make", "-C", str(folder)], check=True, capture_output=True)
    (program,) = folder.glob("*.hex")
    return program


def emulate(
    program: Path,
    seconds: float,
    *,
    work: Path,
    arrivals: Sequence[tuple[float, bytes]] = (),
    baud: float = 9600,
) -> PinTrace:
    """Runs a .hex from reset. `arrivals` are bytes that come over the serial line, each from a time in seconds on.

    `work` is a folder for the trace and the EEPROM; a later run with the same folder finds the EEPROM as it was left.
    """
    trace = work / "trace.vcd"
    command = [_emulator(), program, str(seconds), trace, work / "eeprom.bin", str(baud)]
    command += [f"{at_s}:{sent.hex()}" for at_s, sent in sorted(arrivals)]
    done = subprocess.run(command, check=True, capture_output=True, timeout=limit_s(30))
    edges, end = _read_vcd(trace)
    return PinTrace(edges=edges, end=end, said=done.stdout)


def _emulator() -> Path:
    """The compiled avr_trace.c; compiled again when it has changed."""
    binary = ROOT / "build" / "avr_trace"
    if not binary.exists() or binary.stat().st_mtime < SOURCE.stat().st_mtime:
        binary.parent.mkdir(exist_ok=True)
        fresh = binary.with_name(f"{binary.name}.{os.getpid()}")  # others may be compiling it, too
        command = ["gcc", "-std=gnu11", "-O2", "-Wall", "-Wextra", "-Werror", "-o", fresh, SOURCE, "-lsimavr"]
        subprocess.run(command, check=True)
        fresh.replace(binary)
    return binary


def _read_vcd(path: Path) -> tuple[dict[str, Cycles], int]:
    """Each pin's changes after time 0, and the last time in the file, in clock cycles."""
    names: dict[str, str] = {}
    edges: defaultdict[str, list[int]] = defaultdict(list)
    step = 0
    for line in path.read_text(encoding="ascii").splitlines():
        if line.startswith("$var"):
            signal, pin = line.split()[3:5]
            names[signal] = pin
        elif line.startswith("#"):
            step = int(line[1:])
        elif not line.startswith("$") and step > 0:
            pin = names[line[1:]]
            edges[pin].append(step // _STEPS_PER_CYCLE)
            assert int(line[0]) == len(edges[pin]) % 2, f"{path}: {pin} changes to what it was"
    return {pin: np.array(edges[pin], np.int64) for pin in names.values()}, step // _STEPS_PER_CYCLE
