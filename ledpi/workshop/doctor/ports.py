"""The serial port: which name stays, whether it leads to the pins that are meant, and who else may use it.

What is specific to a Pi is by its documentation, **not seen on hardware**.
"""

from __future__ import annotations

import os
import re
from fnmatch import fnmatchcase
from pathlib import Path

from ledpi.core.linux import described, openers
from ledpi.workshop.doctor.finding import Finding, bad, ok, unknown

DEV, SYS = Path("/dev"), Path("/sys")
OLD_RULE = Path("/etc/udev/rules.d/60-ledpi.rules")
UNIT = Path("/etc/systemd/system/ledpi.service")
DEBUG_CONNECTOR = "ttyAMA10"  # of a Pi 5, 500 and Compute Module 5, between the HDMI sockets
PI_5_CHIP = b"bcm2712"
AT_MOST = 0x10000  # bytes of a file of the kernel's


def names(dev: Path = DEV, sys: Path = SYS) -> list[str]:
    """The name of each USB port that is plugged in, of those that stay: by its board, else by its socket."""
    by_id, by_path = (_links(dev / "serial" / kind) for kind in ("by-id", "by-path"))
    stay = {port: link for port, link in by_id.items() if has_own_number(link, sys)}
    return sorted(str(link) for link in (by_id | by_path | stay).values())


def remedy(dev: Path = DEV, sys: Path = SYS) -> str:
    """Says what to set serial.port to, and why a name is one of a socket."""
    plugged_in = names(dev, sys)
    if not plugged_in:
        return "plug the controller in; `ledpi doctor` then shows what to set serial.port to"
    said = f"set serial.port to the controller's name: {' or '.join(plugged_in)}"
    if any("/by-path/" in name for name in plugged_in):
        said += (
            f" (by-path is the name of a USB socket: a board there {_NO_NUMBER}, and keeps this name in this socket)"
        )
    if any("/by-id/" in name and not has_own_number(Path(name), sys) for name in plugged_in):
        said += f" (a board {_NO_NUMBER}; udev gives it no by-path name here: plug in no second one)"
    return said


_NO_NUMBER = "has no serial number of its own, so that a second one like it would take its by-id name"


def name(port: str, dev: Path = DEV, sys: Path = SYS) -> Finding | None:
    """Finds out whether the configured name stays the controller's; None where it is not by-id's to say."""
    if "/by-id/" not in port or not os.path.exists(port) or has_own_number(Path(port), sys):
        return None
    socket = _links(dev / "serial/by-path").get(os.path.realpath(port))
    other = f"set serial.port to the name of its USB socket: {socket}" if socket else "use no second board like it"
    return unknown("serial name", f"the board {_NO_NUMBER}", other)


def has_own_number(link: Path, sys: Path = SYS) -> bool:
    """Tells whether the board behind a by-id link has a serial number that no other board like it should have.

    As sysfs has it. Where that knows no USB device, by the link's own name, which ends in the number if there is one.
    """
    tty = Path(os.path.realpath(sys / "class/tty" / os.path.basename(os.path.realpath(link))))
    for folder in tty.parents:
        if (folder / "idVendor").exists():
            return _is_own(_text(folder / "serial").strip())
    last = re.sub(r"-if[0-9a-f]{2}(-port\d+)?$", "", link.name).rpartition("_")[2]
    return re.fullmatch(r"(?=.*\d)[0-9A-Za-z]{4,}", last) is not None and _is_own(last)


def _is_own(number: str) -> bool:
    """Not nothing, nor the first of a count: a CP2102 leaves its factory as 0001."""
    return number.strip("0") not in ("", "1")


def _links(folder: Path) -> dict[str, Path]:
    """From device to link. Of two to one device the first by name: by-path has a newer and longer kind, usbv2."""
    try:
        links = sorted(folder.iterdir(), reverse=True)
    except OSError:
        return {}
    return {os.path.realpath(link): link for link in links}


def console(port: str, cmdline: Path = Path("/proc/cmdline")) -> Finding:
    """Finds out whether Linux writes its log to the controller's port."""
    consoles = [word.removeprefix("console=").split(",")[0] for word in _text(cmdline).split() if "console=" in word]
    mine = os.path.realpath(port)
    taken = [name for name in consoles if os.path.realpath(f"/dev/{name}") == mine]
    if taken:
        return bad(
            "serial console",
            f"Linux uses {port} as its console ({taken[0]})",
            "sudo raspi-config nonint do_serial_cons 1, then restart",
        )
    return ok("serial console", f"not on {port}")


def pins(port: str, dev: Path = DEV, compatible: Path = Path("/proc/device-tree/compatible")) -> Finding | None:
    """On a Pi 5, whether a name that means the pins elsewhere leads to the debug connector."""
    if PI_5_CHIP not in _bytes(compatible):
        return None
    target = os.path.basename(os.path.realpath(port))
    if target != DEBUG_CONNECTOR and (port != str(dev / "serial0") or os.path.exists(port)):
        return None
    return bad(
        "serial pins",
        f"{port} is the debug connector of this Pi 5, and not its pins",
        "dtparam=uart0=on in /boot/firmware/config.txt, restart, and set serial.port to /dev/ttyAMA0",
    )


def rule(old: Path = OLD_RULE) -> Finding | None:
    """Finds out whether an older version's udev rule is there, whose name comes too early."""
    if not old.exists():
        return None
    new = old.with_name("61-ledpi.rules")
    return bad(
        "udev rule",
        f"{old} runs before 60-serial.rules, which reads what it compares: no USB board gets a name",
        f"sudo mv {old} {new}; sudo udevadm control --reload; sudo udevadm trigger --subsystem-match=tty",
    )


def allowed(port: str, unit: Path = UNIT, devices: Path = Path("/proc/devices")) -> Finding | None:
    """Finds out whether the service may open a port of this kind, by its unit's DeviceAllow=; None without a unit."""
    drop_ins = sorted(unit.with_name(unit.name + ".d").glob("*.conf"))
    entries = re.findall(r"^DeviceAllow=(\S+)", "\n".join(_text(path) for path in (unit, *drop_ins)), re.MULTILINE)
    try:
        major = os.major(os.stat(port).st_rdev)
    except OSError:
        return None
    kind = re.search(rf"^ *{major} (\S+)$", _text(devices).partition("Block devices")[0], re.MULTILINE)
    if not entries or kind is None:
        return None
    may = {port, os.path.realpath(port)} & set(entries)
    if may or any(fnmatchcase(f"char-{kind[1]}", entry) for entry in entries):
        return None
    return bad(
        "service",
        f"may not open {port}: {unit.name} allows no device of the kind {kind[1]}",
        f"sudo systemctl edit ledpi, there [Service] and DeviceAllow=char-{kind[1]} rw; sudo systemctl restart ledpi",
    )


def shared(port: str, but: int | None) -> Finding | None:
    """Finds out whether processes beside the one with the ID `but` have the port open; None where none is seen."""
    target = os.path.realpath(port)
    is_port = target.startswith("/dev/pts/") or (SYS / "class/tty" / os.path.basename(target)).exists()
    others = openers([port]) - {but} if is_port else set()
    if not others:
        return None
    named = "; ".join(described(pid) for pid in sorted(others))
    return bad("other programs", f"have {port} open: {named}", "end them: what they write there disturbs the stream")


def _text(path: Path) -> str:
    return _bytes(path).decode("utf-8", errors="replace")


def _bytes(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(AT_MOST)
    except OSError:
        return b""
