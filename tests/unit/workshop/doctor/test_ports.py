"""Findings of doctor on the serial port. Boards told from each other by real udev: tests/system/test_udev.py."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from ledpi.config.settings import load_config
from ledpi.workshop.doctor import ports
from ledpi.workshop.doctor.checks import examine
from tests.builders.daemon import controller

UNO = "usb-Arduino__www.arduino.cc__0043_75833353035351E0D1A1-if00"
CH340 = "usb-1a86_USB_Serial-if00-port0"
NO_CAMERA = ("panels.side_m=0.16", "camera.source=v4l2:/dev/video99", "camera.row_time_us=30")  # found out at once
HOLD = "import os, sys; os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); print(flush=True); sys.stdin.read()"


def plug_in(dev: Path, by_id: str, socket: str, tty: str) -> None:
    """As udev links it; no sysfs tells of it."""
    for kind, name in (("by-id", by_id), ("by-path", socket)):
        (dev / "serial" / kind).mkdir(parents=True, exist_ok=True)
        link = dev / "serial" / kind / name
        link.unlink(missing_ok=True)
        link.symlink_to(dev / tty)
    (dev / tty).touch()


def test_nothing_plugged_in_is_to_be_plugged_in(tmp_path: Path) -> None:
    """There is no name to offer."""
    assert ports.remedy(tmp_path).startswith("plug the controller in; ")


def test_a_board_with_a_number_is_offered_by_its_own_name(tmp_path: Path) -> None:
    """It stays in every socket."""
    plug_in(tmp_path, UNO, "pci-0000:00:14.0-usb-0:2:1.0", "ttyACM0")
    assert ports.remedy(tmp_path) == f"set serial.port to the controller's name: {tmp_path}/serial/by-id/{UNO}"


def test_two_boards_without_a_number_are_offered_by_their_sockets(tmp_path: Path) -> None:
    """They share one name by-id, which is the one's that came last; why is said."""
    for port in (1, 2):
        for bus in ("usb", "usbv2"):
            plug_in(tmp_path, CH340, f"pci-0000:00:14.0-{bus}-0:{port}:1.0-port0", f"ttyUSB{port}")
    offered = [f"{tmp_path}/serial/by-path/pci-0000:00:14.0-usb-0:{port}:1.0-port0" for port in (1, 2)]
    said = ports.remedy(tmp_path)
    assert said.startswith(
        f"set serial.port to the controller's name: {' or '.join(offered)} (by-path is the name of a"
    )
    assert "no serial number of its own" in said
    assert "by-id/" not in said


def test_a_board_without_a_number_or_a_socket_s_name_is_told_of(tmp_path: Path) -> None:
    """Without a by-path link another board like it would take the name that is offered."""
    plug_in(tmp_path, CH340, "gone", "ttyUSB0")
    (tmp_path / "serial/by-path/gone").unlink()
    said = ports.remedy(tmp_path)
    assert said.startswith(f"set serial.port to the controller's name: {tmp_path}/serial/by-id/{CH340} (a board has no")
    assert "plug in no second one" in said


@pytest.mark.parametrize(
    ("by_id", "own"),
    [
        (UNO, True),
        (CH340, False),
        ("usb-1a86_USB2.0-Serial-if00-port0", False),
        ("usb-Raspberry_Pi_Pico_E6605838834F5C2B-if00", True),
        ("usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0", True),
        ("usb-Prolific_Technology_Inc._USB-Serial_Controller_D-if00-port0", False),
        ("usb-Silicon_Labs_CP2102_USB_to_UART_Bridge_Controller_0001-if00-port0", False),
    ],
)
def test_a_number_that_every_board_of_the_kind_has_is_none(tmp_path: Path, by_id: str, own: bool) -> None:
    """Some leave the factory with none, some with the first of a count."""
    plug_in(tmp_path, by_id, "pci-usb-0:1:1.0", "ttyUSB0")
    link = tmp_path / "serial/by-id" / by_id
    assert ports.has_own_number(link) is own
    assert (ports.name(str(link), tmp_path) is None) is own


def test_a_shared_name_in_the_configuration_is_noted(tmp_path: Path) -> None:
    """The stream works, until a second such board is plugged in."""
    plug_in(tmp_path, CH340, "pci-usb-0:1:1.0", "ttyUSB0")
    found = ports.name(f"{tmp_path}/serial/by-id/{CH340}", tmp_path)
    assert found is not None
    assert (found.state, found.remedy) == (
        "unknown",
        f"set serial.port to the name of its USB socket: {tmp_path}/serial/by-path/pci-usb-0:1:1.0",
    )


@pytest.mark.parametrize(
    ("chip", "target", "bad"),
    [
        ("bcm2712", "ttyAMA10", True),
        ("bcm2712", None, True),
        ("bcm2712", "ttyAMA0", False),
        ("bcm2711", "ttyS0", False),
    ],
)
def test_the_debug_connector_of_a_pi_5_is_not_its_pins(
    tmp_path: Path, chip: str, target: str | None, bad: bool
) -> None:
    """`/dev/serial0` is the pins on each Pi before; on a Pi 5 too, where somebody has made it so."""
    compatible = tmp_path / "compatible"
    compatible.write_bytes(f"raspberrypi,some-model\0brcm,bcm{chip}\0".encode())
    if target is not None:
        (tmp_path / target).touch()
        (tmp_path / "serial0").symlink_to(tmp_path / target)
    found = ports.pins(str(tmp_path / "serial0"), tmp_path, compatible)
    assert (found is not None) is bad
    assert found is None or ("debug connector" in found.said and "/dev/ttyAMA0" in found.remedy)


def test_a_console_on_the_controller_s_port_is_seen(tmp_path: Path) -> None:
    """As Raspberry Pi OS has it at first: boot messages would reach the motor controller."""
    cmdline = tmp_path / "cmdline"
    cmdline.write_text("console=ttyAMA0,115200 console=tty1 root=PARTUUID=1-02 rootwait\n")
    found = ports.console("/dev/ttyAMA0", cmdline)
    assert found.state == "bad"
    assert "raspi-config" in found.remedy
    assert ports.console("/dev/ttyUSB0", cmdline).state == "ok"


def test_the_rule_of_an_older_version_is_seen(tmp_path: Path) -> None:
    """By its name, which comes too early."""
    old = tmp_path / "60-ledpi.rules"
    assert ports.rule(old) is None
    old.touch()
    found = ports.rule(old)
    assert found is not None
    assert found.remedy.startswith(f"sudo mv {old} {tmp_path}/61-ledpi.rules; ")


@pytest.mark.parametrize(
    ("lines", "may"),
    [
        ("DeviceAllow=char-pts rw", True),
        ("DeviceAllow=char-p* rw", True),
        ("DeviceAllow={port} rw", True),
        ("DeviceAllow=char-ttyACM rw", False),
        ("Nice=5", True),
    ],
)
def test_a_kind_of_port_that_the_service_may_not_open_is_named(tmp_path: Path, lines: str, may: bool) -> None:
    """With what to add; where the unit allows every device, or there is none, nothing is said."""
    unit = tmp_path / "ledpi.service"
    unit.write_text("[Service]\n")
    (tmp_path / "ledpi.service.d").mkdir()
    with controller() as line:
        major = os.major(os.stat(line.port).st_rdev)
        devices = tmp_path / "devices"
        devices.write_text(f"Character devices:\n  4 tty\n{major} pts\n\nBlock devices:\n{major} sd\n")
        (tmp_path / "ledpi.service.d/own.conf").write_text(f"[Service]\n{lines.format(port=line.port)}\n")
        found = ports.allowed(line.port, unit, devices)
    assert (found is None) is may
    assert found is None or "DeviceAllow=char-pts rw" in found.remedy


@pytest.mark.slow
def test_who_has_the_port_open_is_named(tmp_path: Path) -> None:
    """Beside the daemon that runs."""
    with controller() as line:
        command = [sys.executable, "-c", HOLD, line.port]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
            assert other.stdout is not None
            other.stdout.readline()
            assert ports.shared(line.port, but=other.pid) is None
            found = ports.shared(line.port, but=None)
            page = list(examine(load_config(None, (*NO_CAMERA, f"serial.port={line.port}"))))
            other.kill()
    assert found is not None
    assert f"(process {other.pid}); stop it with: sudo " in found.said
    assert found in page
