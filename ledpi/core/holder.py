"""Which process holds a device, and how to stop it. Reads /proc; Linux only, like every camera here."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable
from pathlib import Path


def who_holds(pattern: str) -> str | None:
    """As `held by python3 (process 812); stop it with: sudo systemctl stop ledpi`, or None where none is seen.

    A process that has locked one of the files of `pattern` (as libcamera does, /dev/media*), else one that has it open;
    without root only one's own are seen of the latter.
    """
    paths = glob.glob(pattern)
    holder = _locker(paths) or min(openers(paths), default=None)
    return None if holder is None else f"held by {described(holder)}"


def described(pid: int) -> str:
    """As `python3 (process 812); stop it with: sudo systemctl stop ledpi`."""
    return f"{_name(pid)} (process {pid}); stop it with: {_stop_command(pid)}"


def _locker(paths: list[str]) -> int | None:
    try:
        locks = Path("/proc/locks").read_text(encoding="ascii")
    except OSError:
        return None
    return locker_in(locks, [file for path in paths if (file := _status(path)) is not None])


def _status(path: str) -> os.stat_result | None:
    """None for a device that has gone since it was listed."""
    try:
        return os.stat(path)
    except OSError:
        return None


def locker_in(locks: str, files: list[os.stat_result]) -> int | None:
    """The process that has locked one of `files`, by the text of /proc/locks, which shows everyone's to everyone.

    A line: `1: POSIX  ADVISORY  WRITE 812 00:05:433 0 EOF`, with the file's device (hexadecimal) and inode; one that
    waits for a lock has an arrow after the number.
    """
    keys = {f"{os.major(file.st_dev):02x}:{os.minor(file.st_dev):02x}:{file.st_ino}" for file in files}
    for line in locks.splitlines():
        fields = line.split()
        if "->" not in fields and fields[5] in keys and int(fields[4]) not in (os.getpid(), -1):
            return int(fields[4])
    return None


def openers(paths: Iterable[str]) -> set[int]:
    """The processes beside this one that have one of `paths` open; without root, of this user's only."""
    wanted = {os.path.realpath(path) for path in paths}
    found = set()
    for link in glob.iglob("/proc/[0-9]*/fd/*"):
        try:
            if os.readlink(link) in wanted:
                found.add(int(link.split("/")[2]))
        except OSError:  # ended meanwhile, or another user's
            continue
    return found - {os.getpid()}


def _name(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/comm").read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return "another process"


def _stop_command(pid: int) -> str:
    """systemctl where the process is a system service's, which would start it again after a kill."""
    try:
        unit = Path(f"/proc/{pid}/cgroup").read_text(encoding="utf-8").strip().rpartition("/")[2]
    except OSError:
        unit = ""
    return f"sudo systemctl stop {unit.removesuffix('.service')}" if unit.endswith(".service") else f"sudo kill {pid}"
