"""File systems that live in memory, as raspi-config's overlay: what is written there is gone after a reboot."""

from __future__ import annotations

import os
import re
from pathlib import Path

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
