"""The names of serial ports, as the real udev makes them of boards that umockdev plugs in."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from tests.builders import ROOT
from tests.builders.umockdev import Board, plugged_in, with_boards, works

pytestmark = pytest.mark.skipif(not works(), reason="needs udev, umockdev and root")

RULES = (ROOT / "systemd/61-ledpi.rules").read_text(encoding="utf-8")
UNO = Board(
    socket=1, vendor="2341", product="0043", maker="Arduino (www.arduino.cc)", serial="7583335", ttys=("ttyACM0",)
)
PICO = Board(
    socket=2, vendor="2e8a", product="000a", maker="Raspberry Pi", name="Pico", serial="E6605838", ttys=("ttyACM1",)
)
FTDI = Board(socket=3, vendor="0403", product="6001", maker="FTDI", name="FT232R", serial="A50285BI", ttys=("ttyUSB0",))
CP2102 = Board(
    socket=4, vendor="10c4", product="ea60", maker="Silicon Labs", name="CP2102", serial="0001", ttys=("ttyUSB1",)
)
CH340 = [Board(socket=n, vendor="1a86", product="7523", name="USB Serial", ttys=(f"ttyUSB{n}",)) for n in (5, 6)]
DOCTOR = f"{sys.executable} -c 'from ledpi.workshop.doctor.ports import remedy; print(remedy())'"


def properties(said: str) -> dict[str, str]:
    """Returns what udev knows of a device."""
    return dict(re.findall(r"^(\w+)=(.*)$", said, re.MULTILINE))


def changed(example: str, **values: str) -> str:
    """The rules, with the example that begins so in force, and a board's own numbers in it: as a user changes it."""
    (line,) = re.findall(rf"^# (ENV\{{{example}\}}==.*)$", RULES, re.MULTILINE)
    rule = line
    for key, value in values.items():
        rule, number = re.subn(rf'(ENV\{{{key}\}}==)"[^"]*"', rf'\1"{value}"', rule)
        assert number == 1
    return RULES.replace(f"# {line}", rule)


def controller(said: str) -> bool:
    """Tells whether it has the name that is serial.port's default, and is no modem to ModemManager."""
    known = properties(said)
    linked = "/dev/ledpi-controller" in known["DEVLINKS"].split()
    assert linked is (known.get("ID_MM_DEVICE_IGNORE") == "1")
    return linked


@pytest.mark.parametrize("board", [UNO, PICO, FTDI, CP2102])
def test_a_board_is_named_by_its_numbers(board: Board, tmp_path: Path) -> None:
    """Those that `udevadm info` shows, put into the rule's example; another board has not the name."""
    mine = changed("ID_VENDOR_ID", ID_VENDOR_ID=board.vendor, ID_MODEL_ID=board.product, ID_SERIAL_SHORT=board.serial)
    for other in (board, CH340[0]):
        folder = tmp_path / str(other.socket)
        folder.mkdir()
        said = with_boards(folder, [board, CH340[0]], {"61-ledpi.rules": mine}, plugged_in(other.ttys[0]))
        assert controller(said) is (other is board)


def test_a_board_without_a_number_is_named_by_its_socket(tmp_path: Path) -> None:
    """Names, of two that are alike, the one in that socket."""
    socket = "pci-0000:00:14.0-usb-0:6:1.0"
    for board in CH340:
        folder = tmp_path / str(board.socket)
        folder.mkdir()
        rules = {"61-ledpi.rules": changed("ID_PATH", ID_PATH=socket)}
        assert controller(with_boards(folder, CH340, rules, plugged_in(board.ttys[0]))) is (board.socket == 6)


def test_no_board_has_the_name_until_someone_says_so(tmp_path: Path) -> None:
    """The rules as they are installed."""
    assert not controller(with_boards(tmp_path, [UNO], {"61-ledpi.rules": RULES}, plugged_in("ttyACM0")))


def test_a_file_that_comes_too_early_gives_no_name(tmp_path: Path) -> None:
    """As 60-ledpi.rules of older versions, before 60-serial.rules: so the tests above can fail."""
    mine = changed("ID_VENDOR_ID")
    assert not controller(with_boards(tmp_path, [UNO], {"60-ledpi.rules": mine}, plugged_in("ttyACM0")))


def test_doctor_offers_the_names_that_stay(tmp_path: Path) -> None:
    """Offers by-path for two boards that share one by-id name, and for one with a number that all have; else by-id."""
    boards = [UNO, FTDI, CP2102, *CH340]
    heard = "; ".join(plugged_in(tty) for board in boards for tty in board.ttys)
    said = with_boards(tmp_path, boards, {}, f"({heard}) >heard; {DOCTOR}")
    offered = re.findall(r"/dev/serial/(\S+)", said)
    assert offered == [
        "by-id/usb-Arduino__www.arduino.cc__0043_7583335-if00",
        "by-id/usb-FTDI_FT232R_A50285BI-if00-port0",
        *(f"by-path/pci-0000:00:14.0-usb-0:{socket}:1.0-port0" for socket in (4, 5, 6)),
    ]
    assert "no serial number of its own" in said
