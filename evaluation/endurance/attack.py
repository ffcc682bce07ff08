"""Attacks what reads pictures, recordings and packets, in programs that gcc's sanitizers watch.

Builds ledpi's C core with AddressSanitizer and UndefinedBehaviorSanitizer. Then three attacks run side by side for so
many minutes: hostile pictures into `Pipeline.decode` (hostile.py scene), damaged recordings into the reader and the
decoder (hostile.py recording), and random bytes into the reference receiver (tests/builders/receiver_fuzz_loop.c).
Exit status 1 where one of them failed; what it said, and the command that does the same again, are printed.
docs/attacks.md says what is attacked, and what has to hold. Needs gcc.

    python -m evaluation.endurance.attack [--minutes 30] [--seed 1]
    python -m evaluation.endurance.attack --short              # as CI does: the same scenes each time
    python -m evaluation.endurance.attack --seed 1 --scene 12345   # once more, this scene only (or --recording 12345)
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from evaluation import ROOT

# They end the process, with a report on standard error: at a read or write beside what was allocated, at a use after
# free, at arithmetic that C does not define, and at a number that is too large for its integer.
FLAGS = "-fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all -fno-omit-frame-pointer -g"
LEFT_OUT = shutil.ignore_patterns(".*", "*.so", "build", "*.egg-info", "docs", "tests", "evaluation", "__pycache__")
READ_BESIDE = """
import numpy as np
from ledpi.core.library import ffi, lib, pointer
pixels, room, corners = np.zeros(99, np.uint8), np.zeros(lib.ledpi_lattice_room(10, 10), np.uint8), np.zeros((1, 4, 2))
pictures = ffi.new("PyramidPicture[]", [(pointer(pixels), 10, 10)])
lib.ledpi_lattice_squares(pictures, 1, 4, pointer(room), 1, pointer(corners))
"""


def build(folder: Path) -> Path:
    """Installs a copy of this clone in `folder`; returns where. Raises RuntimeError where its core is not watched."""
    source, built = folder / "source", folder / "built"
    shutil.copytree(ROOT, source, ignore=LEFT_OUT)
    install = ["pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps", "--target", str(built)]
    flags = {"CFLAGS": FLAGS, "LDFLAGS": FLAGS}
    subprocess.run([sys.executable, "-m", *install, str(source)], env=os.environ | flags, check=True)
    if not any(b"__asan_" in core.read_bytes() for core in built.glob("ledpi/core/*.so")):
        raise RuntimeError("the core was not built with sanitizers")
    shutil.copytree(ROOT / "evaluation", built / "evaluation", ignore=LEFT_OUT)  # which attack it
    return built


def environment(built: Path) -> dict[str, str]:
    """In which Python takes ledpi from `built`, and each allocation is watched, numpy's too."""
    runtimes = [
        subprocess.run(["gcc", f"-print-file-name={name}"], capture_output=True, text=True, check=True).stdout.strip()
        for name in ("libasan.so", "libstdc++.so.6")  # the second one, as OpenCV's exceptions are watched, too
    ]
    return os.environ | {
        "LD_PRELOAD": " ".join(runtimes),
        "ASAN_OPTIONS": "detect_leaks=0",  # Python never frees what lives as long as it does
        "UBSAN_OPTIONS": "print_stacktrace=1",
        "PYTHONMALLOC": "malloc",
        "PYTHONPATH": str(built),
        "OPENBLAS_NUM_THREADS": "1",
    }


def check_it_sees(run_in: dict[str, str]) -> None:
    """Raises RuntimeError where the core that Python takes reads beside a numpy array, and that is not reported.

    Silence would mean nothing then: another core is taken, or numpy's memory is not watched.
    """
    command = [sys.executable, "-P", "-c", READ_BESIDE]
    done = subprocess.run(command, env=run_in, capture_output=True, text=True, check=False)
    if done.returncode == 0 or "heap-buffer-overflow" not in done.stderr:
        raise RuntimeError(f"the sanitizers do not see what they should: {done.stderr[-2000:]}")


HOSTILE = "evaluation.endurance.hostile"
GRACE_S = 300  # for what was begun when the time was over
SHORT_SCENES, SHORT_RECORDINGS, SHORT_RECEIVER_S = 12, 80, 25
SHORT_S = 600  # ends none of them: they are fewer than a busy machine does in that time


@dataclass(frozen=True)
class Attack:
    """One process."""

    name: str
    command: list[str]
    again: str = ""  # the option that repeats what its last line of output names: `scene` of "scene 123"
    seed: int = 0


def python(module: str, *options: object) -> list[str]:
    return [sys.executable, "-m", module, *map(str, options)]


def built_receiver(folder: Path) -> str:
    """The program that feeds the reference receiver."""
    program = folder / "receiver"
    source = ROOT / "tests/builders/receiver_fuzz_loop.c"
    header = f"-I{ROOT / 'firmware' / 'receiver'}"
    subprocess.run(["gcc", "-std=c99", "-O1", *FLAGS.split(), header, "-o", str(program), str(source)], check=True)
    return str(program)


def attacks(seed: int, seconds: float, receiver: str, *, short: bool) -> list[Attack]:
    """Pictures on all processors but one, which the recordings have; the receiver beside them needs little time.

    `short`: with an end to each before the time is over, so that what is attacked does not depend on the machine.
    """
    processes = 1 if short else max((os.cpu_count() or 2) - 1, 1)
    scenes, recordings = (("--most", SHORT_SCENES), ("--most", SHORT_RECORDINGS)) if short else ((), ())
    pictures = [
        Attack("pictures", python(HOSTILE, "scene", "--seconds", seconds, *scenes, "--seed", own), "scene", own)
        for own in range(seed, seed + processes)
    ]
    damaged = python(HOSTILE, "recording", "--seconds", seconds, *recordings, "--seed", seed)
    random_bytes = [receiver, str(SHORT_RECEIVER_S if short else max(round(seconds / 4), 1)), str(seed)]
    return [*pictures, Attack("recordings", damaged, "recording", seed), Attack("receiver", random_bytes)]


def one(seed: int, scene: int | None, recording: int | None) -> Attack:
    """A single scene or recording."""
    name, kind, number = ("recordings", "recording", recording) if scene is None else ("pictures", "scene", scene)
    return Attack(name, python(HOSTILE, kind, "--seed", seed, "--only", number), kind, seed)


def run(chosen: list[Attack], run_in: dict[str, str], folder: Path, seconds: float) -> bool:
    """All at once. Prints what each has come to, and returns whether none has failed."""
    running = []
    for number, attack in enumerate(chosen):
        output = folder / f"{number}.txt"
        with output.open("w") as file:
            # In a folder without a ledpi of its own: Python looks there first.
            process = subprocess.Popen(attack.command, cwd=folder, env=run_in, stdout=file, stderr=subprocess.STDOUT)
            running.append(process)
    ends_s = time.monotonic() + seconds + GRACE_S
    results = []
    for number, (attack, process) in enumerate(zip(chosen, running, strict=True)):
        try:
            status: int | str = process.wait(max(ends_s - time.monotonic(), 0))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            status = "it hung"
        results.append(report(attack, status, (folder / f"{number}.txt").read_text(encoding="utf-8", errors="replace")))
    return all(results)


def report(attack: Attack, status: int | str, output: str) -> bool:
    """Prints what one has come to, and returns whether that is well."""
    lines = output.splitlines()
    if status == 0:
        print(f"{attack.name}: nothing found: {lines[-1] if lines else ''}")
        return True
    print(f"{attack.name}: FAILED, {status if isinstance(status, str) else f'status {status}'}")
    begun = [line for line in lines if attack.again and line.startswith(f"{attack.again} ")]
    print("\n".join(line for line in lines if line not in begun))
    if begun:
        print(f"again: python -m evaluation.endurance.attack --seed {attack.seed} --{begun[-1]}")
    return False


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--short", action="store_true", help="as CI does: some three minutes in all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--scene", type=int, help="this one only")
    parser.add_argument("--recording", type=int, help="this one only")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run_in = environment(build(folder))
        check_it_sees(run_in)
        seconds = SHORT_S if given.short else 60 * given.minutes
        if given.scene is not None or given.recording is not None:
            chosen = [one(given.seed, given.scene, given.recording)]
        else:
            chosen = attacks(given.seed, seconds, built_receiver(folder), short=given.short)
        sys.exit(0 if run(chosen, run_in, folder, seconds) else 1)


if __name__ == "__main__":
    main()
