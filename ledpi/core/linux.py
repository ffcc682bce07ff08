"""Words of Linux on this machine: which process holds a device, which file systems live in memory. Reads /proc."""

from __future__ import annotations

import glob
import os
import re
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


_IN_MEMORY = ("tmpfs", "ramfs")
_OLD_OVERLAY = "boot=overlay"  # of older Raspberry Pi OS, whose upper layer is out of sight
_ESCAPED = re.compile(r"\\([0-7]{3})")  # blanks and line breaks in a path


def lost_at_reboot(path: Path) -> str:
    """Says why a file there does not outlive a reboot; "" where it does, or where nothing tells."""
    kind, options = _mount_of(path)
    if kind in _IN_MEMORY:
        return f"{path}: lies in memory ({kind}): what is written there is gone after a reboot"
    upper = options.get("upperdir", "")
    if kind == "overlay" and ((upper and _mount_of(Path(upper))[0] in _IN_MEMORY) or _OLD_OVERLAY in _command_line()):
        return f"{path}: lies on an overlay in memory (a read-only root): what is written is gone after a reboot"
    return ""


def _mount_of(path: Path) -> tuple[str, dict[str, str]]:
    """Kind and options of the file system on which `path` lies, as proc_pid_mountinfo(5) has them."""
    real = Path(os.path.realpath(path))
    try:
        lines = Path("/proc/self/mountinfo").read_text(encoding="utf-8", errors="surrogateescape").splitlines()
    except OSError:
        return "", {}
    best, found = -1, ""
    for line in lines:
        point = _ESCAPED.sub(lambda octal: chr(int(octal[1], 8)), line.split(" ")[4])
        if real.is_relative_to(point) and len(point) >= best:  # of two at one place the later one is seen
            best, found = len(point), line
    kind, _, rest = found.partition(" - ")[2].partition(" ")
    options = rest.partition(" ")[2].split(",")
    return kind, {key: value for key, _, value in (option.partition("=") for option in options)}


def _command_line() -> list[str]:
    try:
        return Path("/proc/cmdline").read_text(encoding="utf-8", errors="replace").split()
    except OSError:
        return []
