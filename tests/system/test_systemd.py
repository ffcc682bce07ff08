"""The services: their units as systemd reads them, and what the daemon tells systemd."""

from __future__ import annotations

import os
import re
import socket
import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import pytest

from ledpi.daemon.daemon import TICK_S
from ledpi.daemon.reporting import Watchdog, notify, watchdog_period_s
from ledpi.daemon.tap.places import GROUP, NAME, SERVICE
from tests.builders import ROOT
from tests.builders.systemd import Unit, assert_closed_in, needs_systemd, said_of

UNIT, BRIDGE, VIEW = (Unit(f"ledpi{name}.service") for name in ("", "-bridge@", "-view"))
each_service = pytest.mark.parametrize("service", [UNIT, BRIDGE, VIEW], ids=lambda service: service.path.name)


@needs_systemd
@each_service
def test_a_unit_is_clean_and_closed_in(tmp_path: Path, service: Unit) -> None:
    """No unknown key, no key in the wrong section, no bad value, and little that it could do by systemd's measure.

    The check can fail: a key that systemd does not know is reported.
    """
    unit = service.copy_to(tmp_path).rename(tmp_path / service.path.name.replace("@", "@field"))
    assert said_of(unit) == ""
    assert_closed_in(unit)
    unit.write_text(unit.read_text(encoding="utf-8").replace("Restart=", "ReStart="), encoding="utf-8")
    assert "ReStart" in said_of(unit)


@each_service
def test_a_mistake_of_the_owner_is_not_tried_again_but_a_failure_is(service: Unit) -> None:
    """Exit status 2 waits for a person; anything else is restarted, the daemon for ever."""
    assert (service.values("Restart"), service.values("RestartPreventExitStatus")) == (["on-failure"], ["2"])
    if service is UNIT:
        assert UNIT.values("RestartForceExitStatus") == ["SIGHUP"]  # which systemd takes for a wish, as SIGTERM
        assert UNIT.values("StartLimitIntervalSec") == ["0"]
        assert (UNIT.values("Type"), UNIT.values("WatchdogSec")) == (["notify"], ["10"])


def test_page_and_bridges_may_read_the_tap_and_are_never_in_the_daemons_way() -> None:
    """As members of the group; the page, which the network reaches, with a user of its own and no rights."""
    for service in (BRIDGE, VIEW):
        assert (service.values("DynamicUser"), service.values("Group")) == (["yes"], [GROUP])
        assert int(*service.values("Nice")) > 0
    assert VIEW.values("User") == ["ledpi-view"]
    assert (VIEW.values("NoNewPrivileges"), VIEW.values("CapabilityBoundingSet")) == (["yes"], [""])
    assert VIEW.values("CPUSchedulingPolicy") == ["batch"]


@needs_systemd
def test_the_pages_lines_make_a_bridge_of_another_camera(tmp_path: Path) -> None:
    """Clean, too; the last ExecStart counts."""
    unit = BRIDGE.copy_to(tmp_path).rename(tmp_path / "ledpi-bridge@field.service")
    (lines,) = re.findall(r"```ini\n(.*?)```", (ROOT / "docs/outputs.md").read_text(encoding="utf-8"), re.DOTALL)
    folder = unit.with_name(f"{unit.name}.d")
    folder.mkdir()
    (folder / "override.conf").write_text(lines.replace("/usr/local/bin/ledpi ", "/bin/true "), encoding="utf-8")
    assert said_of(unit) == ""
    assert "--config /etc/ledpi/front.yaml" in lines


def test_the_devices_that_the_daemon_needs_stay_usable() -> None:
    """Cameras, the media graph, frame buffers and all kinds of serial port; nothing hides them."""
    allowed = {line.split()[0] for line in UNIT.values("DeviceAllow") if line.endswith(" rw")}
    serial = {f"char-{name}" for name in ("ttyAMA", "ttyS", "ttyACM", "ttyUSB", "ttyGS", "ttySC", "ttyMAX", "rfcomm")}
    assert allowed == {"char-video4linux", "char-media", "char-dma_heap"} | serial
    assert UNIT.values("PrivateDevices") == ["no"]
    assert UNIT.values("SupplementaryGroups") == ["video dialout"]
    assert "AF_NETLINK" in UNIT.values("RestrictAddressFamilies")[0]
    assert UNIT.values("InaccessiblePaths") + UNIT.values("TemporaryFileSystem") == []  # /run/udev is not hidden


def test_the_taps_socket_is_for_a_group_that_stays() -> None:
    """systemd makes no user for the time being whose name is that of a group alone, so the user has another name."""
    assert (UNIT.values("DynamicUser"), UNIT.values("Group")) == (["yes"], [GROUP])
    assert UNIT.values("User") != [GROUP]
    assert Path("/run", *UNIT.values("RuntimeDirectory"), NAME) == SERVICE
    assert UNIT.values("RuntimeDirectoryMode") == ["0750"]
    assert "AF_UNIX" in UNIT.values("RestrictAddressFamilies")[0]


def test_frames_do_not_wait_for_other_work_nor_does_the_machine_for_a_daemon_that_runs_amok() -> None:
    """It runs before all that has no real-time priority, and after the kernel's threads for interrupts (50).

    It may have less than the 512 MB of the smallest Raspberry Pi that is in scope.
    """
    assert UNIT.values("CPUSchedulingPolicy") == ["fifo"]
    assert 1 <= int(*UNIT.values("CPUSchedulingPriority")) < 50
    (limit,) = UNIT.values("MemoryMax")
    assert 200 <= int(limit.removesuffix("M")) < 512


# ---- What the daemon tells systemd


@pytest.fixture(params=["file", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """A real socket in systemd's place, once as a file and once abstract."""
    address = str(tmp_path / "notify") if request.param == "file" else f"@ledpi-test-{os.getpid()}"
    monkeypatch.setenv("NOTIFY_SOCKET", address)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(address.replace("@", "\0") if request.param == "abstract" else address)
        listener.settimeout(10)
        yield listener


def test_messages_arrive(manager: socket.socket) -> None:
    """Each is one datagram, as it was given."""
    assert notify("READY=1")
    assert notify("STATUS=no fix: kein Signal für 3 s")
    assert manager.recv(4096) == b"READY=1"
    assert manager.recv(4096).decode() == "STATUS=no fix: kein Signal für 3 s"


def test_outside_a_service_nothing_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Started by hand there is nobody to tell, and that is no error."""
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    assert not notify("READY=1")


@pytest.mark.parametrize("address", ["/nowhere/notify", "@ledpi-nobody-listens", "vsock:2:1234", ""])
def test_a_socket_that_is_gone_does_no_harm(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The daemon goes on; it is told that nobody heard."""
    monkeypatch.setenv("NOTIFY_SOCKET", address)
    assert not notify("WATCHDOG=1")


@pytest.mark.parametrize("frame_s", [0.017, 0.15])
def test_the_watchdog_is_fed_at_least_each_2_s(
    frame_s: float, manager: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Though only each tick looks, and a frame may be in work then. WatchdogSec=10 reaches us in µs."""
    now_s, fed_s = 0.0, list[float]()
    monkeypatch.setenv("WATCHDOG_USEC", "10000000")
    monkeypatch.setenv("WATCHDOG_PID", str(os.getpid()))
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    watchdog = Watchdog()
    manager.setblocking(False)
    while now_s < 20.0:
        watchdog.update(steps=1 + int(now_s / frame_s))
        with suppress(BlockingIOError):
            assert manager.recv(4096) == b"WATCHDOG=1"
            fed_s.append(now_s)
        now_s += TICK_S + 0.002
    assert fed_s[0] == 0.0
    assert all(1.0 < later - before < 2.0 for before, later in pairwise(fed_s))


@pytest.mark.parametrize(("limit", "pid"), [(None, None), ("10000000", "1"), ("x", None), ("0", None)])
def test_no_watchdog_watches_us(limit: str | None, pid: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the variables, or where they are meant for another process, nothing is to be fed."""
    for key, value in [("WATCHDOG_USEC", limit), ("WATCHDOG_PID", pid)]:
        monkeypatch.delenv(key, raising=False)
        if value is not None:
            monkeypatch.setenv(key, value)
    assert watchdog_period_s() is None


# ---- The device's name


def test_the_udev_rules_are_well_formed() -> None:
    """Comments, and lines of known keys, known operators and quoted values; each GOTO has its LABEL."""
    rules = (UNIT.path.parent / "61-ledpi.rules").read_text(encoding="utf-8")
    keys = r"(SUBSYSTEMS?|KERNEL|SYMLINK|GROUP|MODE|GOTO|LABEL|ENV\{\w+\})"
    term = rf'{keys}(==|!=|\+=|=)"[^"]+"'
    lines = [line for line in rules.splitlines() if line and not line.startswith("#")]
    examples = re.findall(r"^# ((?:ENV|KERNEL).*)$", rules, re.MULTILINE)
    assert len(examples) == 3
    for line in lines + examples:
        assert re.fullmatch(rf"{term}(, {term})*", line), line
    assert re.findall(r'GOTO="(\w+)"', rules) == re.findall(r'LABEL="(\w+)"', rules)


def test_no_board_is_the_controller_unless_someone_says_so() -> None:
    """A panel's own Arduino is a ttyACM too: no rule in force gives the name, which is serial.port's default."""
    rules = (UNIT.path.parent / "61-ledpi.rules").read_text(encoding="utf-8")
    assert [line for line in rules.splitlines() if "SYMLINK" in line and not line.startswith("#")] == []
    assert {f"/dev/{name}" for name in re.findall(r'SYMLINK\+="([^"]+)"', rules)} == {"/dev/ledpi-controller"}
