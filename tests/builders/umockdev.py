"""USB boards that are not there, as sysfs shows them (umockdev), and what the real udev makes of them."""

from __future__ import annotations

import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

HOST = "/devices/pci0000:00/0000:00:14.0"
BUS = f"""\
P: {HOST}
E: SUBSYSTEM=pci
E: DRIVER=xhci_hcd
E: PCI_SLOT_NAME=0000:00:14.0

P: {HOST}/usb1
N: bus/usb/001/001
E: DEVNAME=/dev/bus/usb/001/001
E: DEVTYPE=usb_device
E: SUBSYSTEM=usb
"""
# In a mount namespace of its own: /run, where udev keeps what it knows, and /dev, where it makes links.
WITHIN = """
set -e
mkdir "$1/dev"
mount -t tmpfs none "$1/dev"
for name in null zero full random urandom; do touch "$1/dev/$name"; mount --bind /dev/$name "$1/dev/$name"; done
mkdir "$1/dev/char" "$1/dev/pts"
mount --bind /dev/pts "$1/dev/pts"
ln -s pts/ptmx "$1/dev/ptmx"
mount --move "$1/dev" /dev
mount -t tmpfs none /run
mkdir -p /run/udev/rules.d
mount --bind "$1/rules" /run/udev/rules.d
cd "$1"
exec umockdev-run --device boards.umockdev -- /bin/sh -c "$2"
"""


@dataclass(frozen=True, kw_only=True)
class Board:
    """One in USB socket `socket`, with the ports `ttys`: one for each interface."""

    socket: int
    vendor: str
    product: str
    ttys: tuple[str, ...]
    maker: str = ""
    name: str = ""
    serial: str = ""

    def described(self) -> str:
        """As umockdev reads it."""
        usb, number = f"{HOST}/usb1/1-{self.socket}", 10 + self.socket
        strings = {"manufacturer": self.maker, "product": self.name, "serial": self.serial}
        lines = [
            *(f"P: {usb}", f"N: bus/usb/001/{number:03}", f"E: DEVNAME=/dev/bus/usb/001/{number:03}"),
            *("E: DEVTYPE=usb_device", "E: DRIVER=usb", "E: SUBSYSTEM=usb", "E: MAJOR=189", f"E: MINOR={number - 1}"),
            *(f"E: PRODUCT={self.vendor.lstrip('0')}/{self.product.lstrip('0')}/100", "A: bDeviceClass=00"),
            *(f"A: idVendor={self.vendor}", f"A: idProduct={self.product}", "A: bcdDevice=0100"),
            *("A: busnum=1", f"A: devnum={number}", f"A: bNumInterfaces= {len(self.ttys)}"),
            *(f"A: {key}={value}" for key, value in strings.items() if value),
        ]
        for interface, tty in enumerate(self.ttys):
            place = f"{usb}/1-{self.socket}:1.{interface}"
            lines += [
                *(
                    "",
                    f"P: {place}",
                    "E: DEVTYPE=usb_interface",
                    "E: SUBSYSTEM=usb",
                    f"A: bInterfaceNumber={interface:02}",
                ),
                *("A: bInterfaceClass=ff", "A: bInterfaceSubClass=01", "A: bInterfaceProtocol=02"),
            ]
            major, parent = 166, place
            if tty.startswith("ttyUSB"):
                major, parent = 188, f"{place}/{tty}"
                lines += ["", f"P: {parent}", "E: SUBSYSTEM=usb-serial", "A: port_number=0"]
            lines += [
                *("", f"P: {parent}/tty/{tty}", f"N: {tty}", f"E: DEVNAME=/dev/{tty}", "E: SUBSYSTEM=tty"),
                *(f"E: MAJOR={major}", f"E: MINOR={tty[6:]}"),
            ]
        return "\n".join(lines) + "\n"


def works() -> bool:
    """Tells whether udev, umockdev and leave to make a mount namespace are there."""
    if shutil.which("udevadm") is None or shutil.which("umockdev-run") is None or os.geteuid() != 0:
        return False
    return subprocess.run(["unshare", "-m", "true"], check=False, capture_output=True).returncode == 0


def with_boards(folder: Path, boards: list[Board], rules: dict[str, str], command: str) -> str:
    """Returns what a shell command prints where these boards are plugged in, with our rules by their files' names."""
    described = "\n".join([BUS, *(board.described() for board in boards)])
    (folder / "boards.umockdev").write_text(described, encoding="utf-8")
    (folder / "rules").mkdir()
    for name, text in rules.items():
        (folder / "rules" / name).write_text(text, encoding="utf-8")
    done = subprocess.run(
        ["unshare", "-m", "/bin/sh", "-c", WITHIN, "within", str(folder), command],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def plugged_in(tty: str) -> str:
    """A command: udev hears of a port, and does all that its rules say."""
    return f"udevadm test /sys/class/tty/{tty} 2>/dev/null"
