"""The machine: Python and its packages, permissions, disk, clock, throttling.

What is specific to a Pi is by its documentation, **not seen on hardware**.
"""

from __future__ import annotations

import ctypes
import glob
import grp
import os
import platform
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from ledpi import __version__
from ledpi.camera.picamera_version import OLDEST, UPDATE, is_too_old, picamera2_version
from ledpi.core.linux import lost_at_reboot
from ledpi.core.packages import Unusable
from ledpi.core.wording import one_line
from ledpi.workshop.doctor.finding import Finding, bad, ok, unknown

CALIBRATION_FOLDER = Path("/var/lib/ledpi")  # as scripts/install makes it
FREE_BYTES = 1_000_000_000  # a recording of a minute and a half
# Raspberry Pi's documentation of vcgencmd get_throttled: now, and (16 bits up) since boot.
THROTTLED = {0: "under-voltage", 1: "clock capped", 2: "throttled", 3: "too hot"}
VCGENCMD_S = 5.0  # it answers at once, or its driver hangs
IMPORT_S = 60.0  # picamera2 from a slow card takes some 10 s
TIME_ERROR = 5  # of adjtimex(2): the clock is not synchronised
RELEASED = 1735689600  # 2025: a clock that says earlier was never set


def packages() -> Finding:
    """Imported in a process of its own, as a package that was built for another numpy may end it."""
    done = _python("from ledpi.core.packages import tell; tell()")
    if done.returncode == 0:
        return ok("packages", f"ledpi {__version__}, Python {platform.python_version()}, {done.stdout.strip()}")
    if done.returncode == 3 and len(told := done.stdout.splitlines()) == 2:
        return bad("packages", *told, stops_daemon=True)
    return bad("packages", _last_line(done), "install again: sudo scripts/install", stops_daemon=True)


def without(package: Unusable) -> Iterator[Finding]:
    """The page where a package cannot be used: what can be told without it."""
    yield bad("packages", package.said, package.remedy, stops_daemon=True)
    yield unknown("configuration", "it, camera, panels and outputs cannot be looked at without that")
    yield from (disk(), clock(), throttling())


def picamera2() -> Finding:
    """picamera2 and libcamera, and that they fit this numpy."""
    done = _python(
        "import libcamera, picamera2; print(getattr(libcamera.CameraManager, 'version', 'of unknown version'))"
    )
    found = picamera2_version()
    if done.returncode == 0 and is_too_old(found):
        return bad("picamera2", f"{found} is too old; must be {OLDEST} or newer", UPDATE, stops_daemon=True)
    if done.returncode == 0:
        return ok("picamera2", f"picamera2 {found or 'of unknown version'}, libcamera {done.stdout.strip()}")
    said = _last_line(done)
    if "numpy" in said and "No module" not in said:
        remedy = "numpy does not fit the system's picamera2; install again: sudo scripts/install"
    else:
        remedy = "sudo apt install python3-picamera2, and a virtual environment with --system-site-packages"
    return bad("picamera2", said, remedy, stops_daemon=True)


def permissions(patterns: tuple[str, ...]) -> Finding:
    """Finds out whether the devices that are there can be used by this user."""
    devices = sorted(path for pattern in patterns for path in glob.glob(pattern))
    if not devices:
        return unknown("permissions", f"no {' or '.join(patterns)} here")
    closed = [path for path in devices if not os.access(path, os.R_OK | os.W_OK)]
    if not closed:
        return ok("permissions", ", ".join(devices[:4]) + (", …" if len(devices) > 4 else ""))
    try:
        group = grp.getgrgid(os.stat(closed[0]).st_gid).gr_name
    except KeyError:
        group = "video"
    return bad(
        "permissions",
        f"{closed[0]} cannot be used",
        f"sudo usermod -aG {group} $USER, then log in again",
        stops_daemon=True,
    )


def disk(folder: Path = CALIBRATION_FOLDER) -> Finding:
    """Room for calibration and recordings, and whether calibration can be written."""
    if not folder.is_dir():
        return unknown("disk", f"no {folder} here; sudo scripts/install makes it")
    free = shutil.disk_usage(folder).free
    said = f"{free / 1e9:.1f} GB free at {folder}"
    if not os.access(folder, os.W_OK):
        return bad("disk", f"{folder} cannot be written", "sudo usermod -aG video $USER, then log in again")
    return ok("disk", said) if free >= FREE_BYTES else bad("disk", said, "delete old recordings")


def clock(now_s: float | None = None, *, is_set: bool | None = None) -> Finding:
    """Names of recordings, journals and certificates hang on it: poses carry their age, by a clock that is never set.

    `is_set`: whether something sets it; by default as the kernel says.
    """
    now_s, is_set = time.time() if now_s is None else now_s, _is_set() if is_set is None else is_set
    said = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(now_s))
    if now_s < RELEASED:
        return bad("clock", f"{said}, never set", "connect to a network once, or: sudo date --set …")
    if is_set:
        return ok("clock", f"{said}, kept right by the network or another clock")
    remedy = "a network, chrony or an RTC: docs/raspberry-pi.md#the-clock"
    said = f"{said}; the kernel knows of nothing that keeps it right: times of recordings may be wrong"
    return unknown("clock", said, remedy)


def _is_set() -> bool:
    """Asks the kernel, whom chrony, systemd-timesyncd and ntpd tell."""
    struct_timex = ctypes.create_string_buffer(512)  # more than it takes; of zeros, so that nothing is changed
    try:
        state = ctypes.CDLL(None).adjtimex(struct_timex)
    except (OSError, AttributeError):
        return False
    return bool(0 <= state < TIME_ERROR)


def kept(file: Path) -> Iterator[Finding]:
    """A finding where what is written to a file does not outlive a reboot."""
    if said := lost_at_reboot(file):
        yield unknown("read-only root", said, "to change it for good: docs/raspberry-pi.md#a-read-only-root")


def throttling() -> Finding:
    """Tells what the Pi's firmware says of its power supply and temperature."""
    tool = shutil.which("vcgencmd")
    if tool is None:
        return unknown("throttling", "no vcgencmd here: not a Pi")
    return throttled(_run([tool, "get_throttled"], VCGENCMD_S).stdout.strip())


def throttled(said: str) -> Finding:
    """From vcgencmd's answer, as `throttled=0x50000`."""
    try:
        bits = int(said.partition("=")[2], 16)
    except ValueError:
        return unknown("throttling", f"vcgencmd said {said!r}")
    now = [what for bit, what in THROTTLED.items() if bits >> bit & 1]
    before = [what for bit, what in THROTTLED.items() if bits >> (bit + 16) & 1]
    if now:
        return bad("throttling", f"now: {', '.join(now)}", "a stronger power supply (5.1 V), or cooling")
    if before:
        return bad("throttling", f"since the start: {', '.join(before)}", "a stronger power supply (5.1 V), or cooling")
    return ok("throttling", "never since the start")


def answer_of(command: list[str], timeout_s: float) -> str:
    """Returns what it prints, or says of its failure; in one line."""
    done = _run(command, timeout_s)
    return one_line((done.stdout.strip() or done.stderr.strip()).partition("\n")[0])


def _python(code: str) -> subprocess.CompletedProcess[str]:
    return _run([sys.executable, "-c", code], IMPORT_S)


def _run(command: list[str], timeout_s: float) -> subprocess.CompletedProcess[str]:
    """One that hangs is ended, and has failed: the page goes on."""
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=timeout_s)
    except subprocess.TimeoutExpired:
        said = f"no answer within {timeout_s:g} s"
    except OSError as error:
        said = f"{command[0]}: {error.strerror}"
    return subprocess.CompletedProcess(command, returncode=1, stdout=said, stderr=said)


def _last_line(done: subprocess.CompletedProcess[str]) -> str:
    lines = done.stderr.strip().splitlines()
    return lines[-1] if lines else f"the import ended Python with status {done.returncode}"
