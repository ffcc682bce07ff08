"""The service's life: what systemd and the journal hear, a configuration that changes, the processor's state."""

from __future__ import annotations

import re
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from ledpi import __version__
from ledpi.camera import recovering
from ledpi.camera.simulated import open_simulated
from ledpi.config.settings import load_config
from ledpi.core.records import Decoded, Frame, Rejected
from ledpi.daemon.health import RECENT_S, Health, Processor, RecentPackets, minute_line, read_processor
from ledpi.daemon.reporting import event
from ledpi.daemon.ring import RingCounters
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pipeline.trace import Trace
from ledpi.wire import StatusMessage
from tests.builders import ROOT
from tests.builders.daemon import (
    COMMAND,
    SIMULATED,
    SIMULATED_YAML,
    Controller,
    controller,
    daemon,
    daemon_in_thread,
    end,
    wait_for_log,
)
from tests.builders.wire import decoded, publisher_counters

# ---- As systemd starts it


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], str]]:
    """A socket in systemd's place; each call gives the next thing that it was told."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.settimeout(30)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        yield lambda: listener.recv(4096).decode()


def test_in_a_service_it_says_ready_feeds_the_watchdog_and_says_stopping(
    manager: Callable[[], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In that order. The journal gets single lines with their priority, and not one each second."""
    monkeypatch.setenv("WATCHDOG_USEC", "400000")
    monkeypatch.delenv("WATCHDOG_PID", raising=False)
    with controller() as line, daemon(*SIMULATED, f"serial.port={line.port}") as process:
        said = [manager() for _ in range(8)]  # so some 1.4 s
        ended = end(process, signal.SIGTERM)
        while said[-1] != "STOPPING=1":
            said.append(manager())
    assert said[0] == "READY=1"
    assert set(said[1:-1]) == {"WATCHDOG=1"}
    assert ended.status == 0
    assert all(re.match(r"<[3-6]>\w", entry) for entry in ended.log)
    assert not any("frames/s" in entry for entry in ended.log)
    start = next(entry for entry in ended.log if entry.startswith("<6>start "))
    assert f" version={__version__} source=simulated size=320x240 " in start
    assert f" port={line.port} baud=115200 protocol=ledpi" in start
    assert f"<6>serial_open port={line.port}" in ended.log


def test_a_lost_camera_is_given_up_before_the_watchdog_bites() -> None:
    """Else the journal would say "watchdog", and not what was wrong with the camera."""
    unit = (ROOT / "systemd/ledpi.service").read_text(encoding="utf-8")
    (watchdog_s,) = re.findall(r"^WatchdogSec=(\d+)$", unit, re.MULTILINE)
    assert int(watchdog_s) > recovering.DEADLINE_S


# ---- A configuration that changes


def test_a_good_configuration_is_taken(tmp_path: Path) -> None:
    """Here another port: the old one hears that the stream stops, and the new one gets it."""
    file = tmp_path / "config.yaml"

    def write(line: Controller) -> None:
        file.write_text(f"panels: {{side_m: 0.16}}\n{SIMULATED_YAML}serial: {{port: {line.port}}}\n")

    with controller() as first, controller() as second:
        write(first)
        with daemon(options=("--config", str(file))) as process:
            first.wait_for(lambda c: bool(c.markers))
            write(second)
            process.send_signal(signal.SIGHUP)
            second.wait_for(lambda c: bool(c.markers))
            assert end(process, signal.SIGINT).status == 0
        first.close()
        last = first.got[-1][1]
        assert isinstance(last, StatusMessage)
        assert last.state.name == "STOPPING"


# In front of the daemon: a signal comes as it begins to read its configuration, where exceptions are lost.
TOO_SOON = """
import os, signal
from ledpi.config import settings
find = settings.find_config
def find_config(file):
    try:
        os.kill(os.getpid(), signal.{name})
        [None for _ in range(10**6)]
    except BaseException:
        pass
    return find(file)
settings.find_config = find_config
"""


@pytest.mark.slow
def test_a_signal_that_comes_too_soon_is_not_the_end() -> None:
    """Reloads it once it runs: of SIGHUP systemd would think that somebody wished it."""
    for name, starts in (("SIGHUP", 2), ("SIGUSR1", 1)):
        command = [*COMMAND[:2], TOO_SOON.format(name=name) + COMMAND[2], *COMMAND[3:]]
        with controller() as line, daemon(*SIMULATED, f"serial.port={line.port}", command=command) as process:
            for _ in range(starts):
                wait_for_log(process, "INFO start ")
            line.wait_for(lambda c: bool(c.markers))
            process.send_signal(signal.SIGTERM)
            assert process.stderr is not None
            assert not any(entry.startswith("INFO start ") for entry in process.stderr)
            assert end(process).status == 0


@pytest.mark.slow
def test_a_ctrl_c_that_comes_too_soon_is_the_end() -> None:
    """Though it falls where an exception would be lost."""
    command = [*COMMAND[:2], TOO_SOON.format(name="SIGINT") + COMMAND[2], *COMMAND[3:]]
    with daemon(*SIMULATED, "serial.port=/nowhere/port", command=command) as process:
        assert end(process).status == 130


@pytest.mark.slow
def test_a_reload_does_not_starve_the_watchdog(
    tmp_path: Path, manager: Callable[[], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is fed before the camera is opened again, and by the first frame after: not half of its time later."""
    monkeypatch.setenv("WATCHDOG_USEC", "600000000")
    monkeypatch.delenv("WATCHDOG_PID", raising=False)
    file = tmp_path / "config.yaml"
    with controller() as line:
        file.write_text(f"panels: {{side_m: 0.16}}\n{SIMULATED_YAML}serial: {{port: {line.port}}}\n")
        with daemon(options=("--config", str(file))) as process:
            assert [manager() for _ in range(2)] == ["READY=1", "WATCHDOG=1"]
            process.send_signal(signal.SIGHUP)
            assert [manager() for _ in range(3)] == ["WATCHDOG=1", "READY=1", "WATCHDOG=1"]
            assert end(process, signal.SIGTERM).status == 0


def test_progress_within_a_frame_feeds_the_watchdog(
    manager: Callable[[], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here the first frame ends only once the manager has heard of five pieces of it."""
    fed = threading.Event()

    def endless(
        pipeline: Pipeline, frame: Frame, trace: Trace | None, on_partial: Callable[[Decoded], None]
    ) -> Decoded:
        while not fed.wait(0.05):
            on_partial(decoded(seq=frame.seq))
        return decoded(seq=frame.seq)

    monkeypatch.setenv("WATCHDOG_USEC", "200000")
    monkeypatch.delenv("WATCHDOG_PID", raising=False)
    monkeypatch.setattr(Pipeline, "decode", endless)
    config = load_config(None, (*SIMULATED, "serial.port=/nowhere/port"))
    with daemon_in_thread(config, open_simulated(config, paced=True)):
        try:
            assert [manager() for _ in range(6)] == ["READY=1", *["WATCHDOG=1"] * 5]
        finally:
            fed.set()


# ---- What the journal gets


def test_an_event_is_one_line_of_keys_and_values() -> None:
    """Text with blanks is quoted; what is not known is left out."""
    error = 'no "such" device\n'
    line = event("start", port="/dev/ttyACM0", error=error, calibrated=False, map=None, exposure_us=10000.0)
    assert line == 'start port=/dev/ttyACM0 error="no \\"such\\" device\\n" calibrated=no exposure_us=10000'


def test_of_the_packets_the_last_seconds_are_counted() -> None:
    """Forgets what was lost before."""

    counters = publisher_counters
    recent = RecentPackets(counters())
    assert recent.add(counters(stale=500)) == {"seconds": 1, "sent": 0, "replaced": 0, "stale": 500, "refused": 0}
    for second in range(1, RECENT_S + 1):
        told = recent.add(counters(markers=60 * second, replaced=second, stale=500))
    assert told == {"seconds": RECENT_S, "sent": 60 * RECENT_S, "replaced": RECENT_S, "stale": 0, "refused": 0}


def test_the_minutes_line_has_every_counter() -> None:
    """By stage and reason, with the stages' percentiles, what went out, what did not, and the processor's state."""
    health = Health()
    health.reject(Rejected(stage="capture", reason="truncated"))
    health.add(decoded())
    every = ("fixes", "statuses", "markers", "replaced", "stale", "refused", "cut", "opened")
    health.refresh()
    ring = RingCounters(published=9, taken=8, dropped=1)
    totals = health.totals(ring, publisher_counters(**dict.fromkeys(every, 3)))
    totals = replace(totals, processor=Processor(temperature_c=61, throttling=0x0105))
    line = minute_line(totals)
    assert line == (
        "health frames=9 dropped=1 decoded=1 markers=0 in_view=0 decode_p50_ms=0.00 decode_p99_ms=0.00 "
        "sent.fixes=3 sent.statuses=3 sent.markers=3 unsent.replaced=3 unsent.stale=3 unsent.refused=3 unsent.cut=3 "
        "port_opened=3 port=open temperature_c=61 throttling=0x0105 rejected.capture.truncated=1"
    )


# ---- The processor, from files as a Pi's kernel has them


def test_temperature_and_throttling_are_read(tmp_path: Path) -> None:
    """61.3 °C; 0x50005: under-voltage and throttled, now and since boot."""
    (tmp_path / "class/thermal/thermal_zone0").mkdir(parents=True)
    (tmp_path / "class/thermal/thermal_zone0/temp").write_text("61322\n")
    (tmp_path / "devices/platform/soc/soc:firmware").mkdir(parents=True)
    (tmp_path / "devices/platform/soc/soc:firmware/get_throttled").write_text("50005\n")
    assert read_processor(tmp_path) == Processor(temperature_c=61, throttling=0x0505)


@pytest.mark.parametrize("content", [None, "", "N/A\n"])
def test_what_the_kernel_does_not_tell_is_unknown(tmp_path: Path, content: str | None) -> None:
    """No number is made up."""
    if content is not None:
        (tmp_path / "class/thermal/thermal_zone0").mkdir(parents=True)
        (tmp_path / "class/thermal/thermal_zone0/temp").write_text(content)
    assert read_processor(tmp_path) == Processor(temperature_c=None, throttling=None)


@pytest.mark.parametrize(
    ("file", "content", "throttling"),
    [
        ("get_throttled", "50005", 0x0505),
        ("raspberrypi-hwmon.1.auto/hwmon/hwmon3/in0_lcrit_alarm", "1", 0x0001),
        ("raspberrypi-hwmon.1.auto/hwmon/hwmon3/in0_lcrit_alarm", "0", None),
    ],
)
def test_throttling_is_read_on_a_pi_5_too(tmp_path: Path, file: str, content: str, throttling: int | None) -> None:
    """Its SoC's bus has an address in its name; where the kernel has no file of all bits, under-voltage is told."""
    place = tmp_path / "devices/platform/soc@107c000000/soc@107c000000:firmware" / file
    place.parent.mkdir(parents=True)
    place.write_text(content + "\n")
    assert read_processor(tmp_path).throttling == throttling
