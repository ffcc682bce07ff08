"""`ledpi doctor`: what it finds, what it advises, and when it says that the daemon would run."""

from __future__ import annotations

import json
import os
import tty
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from ledpi import __version__
from ledpi.camera.factory import open_camera
from ledpi.camera.simulate.scenes import ov5647_lens
from ledpi.config.settings import load_config
from ledpi.core.records import CameraInfo
from ledpi.pipeline.diagnosis.diagnose import Note
from ledpi.pipeline.diagnosis.why_not import Why
from ledpi.workshop.doctor import camera, checks, machine
from ledpi.workshop.doctor.camera import findings_of, look
from ledpi.workshop.doctor.checks import configuration, examine
from ledpi.workshop.doctor.finding import Finding, bad, line, ok, unknown, verdict
from tests.builders import ROOT
from tests.builders.command import Run
from tests.builders.faults import FAULTS, RIGHT, camera_of, config_of

INFO = CameraInfo(
    width=640, height=480, exposure_us=9969.0, row_time_us=31.748, transfer="linear", frame_length_rows=509
)
SIMULATED = ("panels.side_m=0.16", "camera.source=simulated")
NO_CAMERA = ("panels.side_m=0.16", "camera.source=v4l2:/dev/video99", "camera.row_time_us=30")  # found out at once


@pytest.fixture
def doctor(ledpi: Run) -> Run:
    return partial(ledpi, "doctor")


def given(*settings: str) -> list[str]:
    return [part for item in settings for part in ("--set", item)]


# ---- The page


def test_a_package_of_another_author_is_no_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`serial` is there, and not pyserial: what it is, and what to do."""
    (tmp_path / "serial.py").touch()
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{ROOT}")
    found = machine.packages()
    assert (found.state, found.stops_daemon) == ("bad", True)
    assert found.said.startswith(f"serial cannot be used: {tmp_path}/serial.py: ")


@pytest.mark.slow
def test_without_a_camera_the_page_says_what_to_do(doctor: Run) -> None:
    """Each ✗ is followed by a remedy, and the exit status says that the daemon would not run."""
    status, out, err = doctor(*given(*NO_CAMERA))
    assert (status, err) == (1, "")
    lines = out.splitlines()
    assert lines[-1].startswith("`ledpi run` would not run: camera")
    bad_lines = [number for number, text in enumerate(lines) if text.startswith("✗")]
    assert any("camera.source: /dev/video99 does not exist" in lines[number] for number in bad_lines)
    assert all("→" in lines[number + 1] for number in bad_lines)


@pytest.mark.slow
def test_where_all_is_well_the_daemon_would_run(doctor: Run) -> None:
    """The simulator and a pty: status 0, as JSON."""
    master, slave = os.openpty()
    tty.setraw(master)
    status, out, _ = doctor("--json", *given(*SIMULATED, f"serial.port={os.ttyname(slave)}"))
    os.close(slave)
    os.close(master)
    assert status == 0, out
    page = json.loads(out)
    assert page["would_run"] is True
    assert page["findings"][1]["said"].startswith(f"ledpi {__version__}, Python 3.")
    states = {finding["name"]: finding["state"] for finding in page["findings"]}
    well = {"configuration", "packages", "camera", "exposure", "row time", "panel frequencies", "intrinsics"}
    assert {name for name, state in states.items() if state == "ok"} >= well | {"serial port"}
    exposure = next(finding for finding in page["findings"] if finding["name"] == "exposure")
    assert exposure["said"] == "9967 µs of 10000 µs asked for"  # 296 rows


HUNG = "{position_m: [4, 1, 1.5], yaw_deg: 180}"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("content", "settings", "state", "stops", "said"),
    [
        (f"format: 1\npanels: {{7: {HUNG}}}\n", (), "ok", False, ""),
        ("7\n", (), "bad", True, ""),
        (f"format: 1\npanels: {{49: {HUNG}, 50: {HUNG}}}\n", (), "bad", False, "DICT_4X4_50 has IDs 0 to 49"),
        (f"format: 1\npanels: {{3: {HUNG}}}\n", (), "bad", False, "ID 3 is reported only if panels.ids lists it: a p"),
        (f"format: 1\npanels: {{3: {HUNG}}}\n", ("panels.ids=[3]",), "ok", False, ""),
    ],
    ids=["sound", "broken", "no such word", "not reported", "listed"],
)
def test_the_map_is_read_as_the_daemon_reads_it(
    tmp_path: Path, content: str, settings: tuple[str, ...], state: str, stops: bool, said: str
) -> None:
    """A broken one stops the daemon; a panel that no camera can read, or that is not reported, is named."""
    (tmp_path / "markers.yaml").write_text(content)
    asked = (*NO_CAMERA, f"map={tmp_path / 'markers.yaml'}", *settings)
    found = next(finding for finding in examine(load_config(None, asked)) if finding.name == "map")
    assert (found.state, found.stops_daemon) == (state, stops)
    assert said in found.said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "state", "said"),
    [
        (
            (),
            "ok",
            "IDs 3, 8 to 9, 17, 22, 30, 33, 37, 47 are reported only if panels.ids lists them: a part or a refl",
        ),
        (("panels.ids=[23, 9]",), "ok", "panels.ids: 9, 23; a mirror, window or glossy floor can show 9 where there"),
        (("panels.ids=[3]", "panels.overrides={7: {duty: 0.4}}"), "bad", "panels.overrides: ID 7 is reported only if"),
    ],
)
def test_which_ids_are_reported_is_said(settings: tuple[str, ...], state: str, said: str) -> None:
    """One that has an override should be."""
    config = load_config(None, (*NO_CAMERA, *settings))
    found = next(finding for finding in examine(config) if finding.name == "panel IDs")
    assert found.state == state
    assert found.said.startswith(said)


def test_a_broken_configuration_is_the_first_finding(doctor: Run, tmp_path: Path) -> None:
    """Nothing else can be looked at."""
    (tmp_path / "config.yaml").write_text("camera: {exposure: 10000}\n")
    status, out, _ = doctor("--config", tmp_path / "config.yaml")
    assert status == 1
    assert "exposure" in out.splitlines()[0]


@pytest.mark.slow
@pytest.mark.skipif(Path("/etc/ledpi/config.yaml").exists(), reason="there is a configuration here")
def test_without_a_configuration_the_page_goes_on(doctor: Run) -> None:
    """All else that is missing is told at once; what to do about the configuration comes first."""
    status, out, _ = doctor()
    lines = out.splitlines()
    assert status == 1
    assert lines[0].startswith("✗ configuration      no configuration: ")
    assert "ledpi config init" in lines[1]
    assert [line for line in lines if line[2:].startswith(("packages", "serial port", "clock"))] != []
    assert lines[-1].startswith("`ledpi run` would not run: configuration")


@pytest.mark.parametrize(
    ("asked_for", "installed", "state"), [(False, True, "unknown"), (True, True, "ok"), (False, False, "ok")]
)
def test_a_configuration_that_hides_the_services_is_reported(
    asked_for: bool, installed: bool, state: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever has edited the service's would see no change; nothing is said where it was asked for."""
    here, service = tmp_path / "config.yaml", tmp_path / "etc.yaml"
    for file in (here, service) if installed else (here,):
        file.write_text("panels: {side_m: 0.16}\n")
    monkeypatch.setattr(checks, "SEARCH_PATH", (here, service))
    found = configuration(here, asked_for=asked_for)
    assert (found.state, str(service) in found.said) == (state, state == "unknown")


@pytest.mark.slow
def test_what_does_not_stop_the_daemon_is_told_all_the_same(tmp_path: Path) -> None:
    """Without the port `run` starts, and keeps trying; an exposure shorter than four rows cannot be had."""
    config = load_config(None, (*SIMULATED, "camera.exposure_us=10", f"serial.port={tmp_path}/none"))
    findings = {finding.name: finding for finding in examine(config)}
    assert findings["serial port"].state == "bad"
    assert not findings["serial port"].stops_daemon
    assert findings["exposure"].state == "bad"
    assert findings["exposure"].said == "the camera exposes for 135 µs, where 10 µs were asked for"


def test_the_last_line_says_what_the_daemon_would_not_do_well() -> None:
    """One ✗ that does not stop it is no reason to say that all is well; a remedy has a line of its own."""
    port, disk = bad("serial port", "no such file", "set it"), bad("disk", "full", "delete", stops_daemon=True)
    assert line(disk) == "✗ disk               full\n                     → delete"
    assert verdict([ok("camera", "there")]) == "`ledpi run` would run"
    assert verdict([ok("camera", "there"), port]) == "`ledpi run` would run, but see to its ✗: serial port"
    assert verdict([port, disk]) == "`ledpi run` would not run: disk"


# ---- The camera


def test_frequencies_that_the_exposure_or_the_frame_period_spoils_are_named() -> None:
    """At 10 ms 1204 Hz leave hardly a band; 504 rows of 31.748 µs are 20.00 cycles of 1250 Hz, over 509 both move."""
    config = load_config(None, ("panels.side_m=0.16",))
    assert camera.frequencies(config, INFO).state == "ok"
    found = camera.frequencies(config, replace(INFO, frame_length_rows=504))
    assert "1250 Hz hardly moves from frame to frame" in found.said
    found = camera.frequencies(load_config(None, ("panels.side_m=0.16", "panels.black_hz=1204")), INFO)
    assert (found.state, "1204 Hz all but vanishes" in found.said) == ("bad", True)


def test_a_lens_that_is_none_is_seen(tmp_path: Path) -> None:
    """The OV5647's is one; ten picture widths of focal length are not, nor a centre in the corner, nor no lens."""
    lens = ov5647_lens()
    assert camera.plausible(lens, Path("camera.yaml")).state == "ok"
    assert camera.plausible(replace(lens, fx=6400.0, fy=6400.0), Path("camera.yaml")).state == "bad"
    assert camera.plausible(replace(lens, cx=20.0), Path("camera.yaml")).state == "bad"
    (tmp_path / "camera.yaml").write_text("nothing")
    found = camera.intrinsics(load_config(None, (*NO_CAMERA, f"camera.intrinsics={tmp_path}/camera.yaml")), None)
    assert (found.state, found.stops_daemon) == ("bad", True)


@pytest.mark.slow
def test_the_camera_is_free_again_after_the_look() -> None:
    """Closes what was opened, so that the next one can have it."""
    config = load_config(None, SIMULATED)
    findings, info = camera.camera(config)
    assert {finding.state for finding in findings} == {"ok"}
    device = open_camera(config, paced=False)
    assert info == device.info
    device.close()


# ---- The panels before the camera


def in_view(name: str) -> list[Finding]:
    fault = FAULTS.get(name, RIGHT)
    config = config_of(fault)
    return look(camera_of(fault, config, paced=False), config)


@pytest.mark.slow
def test_panels_that_are_read_are_named() -> None:
    """Nothing else is told of them."""
    assert in_view("nothing") == [ok("panels", "ID 7, 11 read")]


@pytest.mark.slow
def test_a_panel_that_is_built_wrongly_is_a_fault() -> None:
    """With what to do; the daemon would run."""
    read, wrong = in_view("swapped")
    assert read == ok("panels", "ID 7 read")
    assert (wrong.state, wrong.stops_daemon, wrong.remedy[:8]) == ("bad", False, "exchange")
    assert "is not read: looks like ID 11 with its two frequencies swapped" in wrong.said


@pytest.mark.slow
def test_a_light_may_be_none() -> None:
    """So it is no fault; what helps, if it is a panel, is said all the same."""
    light = in_view("saturated")[-1]
    assert (light.state, light.remedy[:9]) == ("unknown", "less gain")
    assert ", if it is a panel: too bright" in light.said


@pytest.mark.slow
def test_a_picture_in_which_no_panel_can_be_read_is_a_fault() -> None:
    """As a blurred one is. Where some are read all the same, it is good enough."""
    states = {finding.name: finding.state for finding in in_view("out of focus")}
    assert states["picture"] == "bad"
    why = Why([], [Note(says="the picture is blurred", helps="focus")])
    assert findings_of([7], why) == [ok("panels", "ID 7 read")]
    assert findings_of([], Why([], [])) == [unknown("panels", "none in view")]


# ---- The machine


@pytest.mark.parametrize(
    ("said", "state", "text"),
    [
        ("throttled=0x0", "ok", "never"),
        ("throttled=0x50000", "bad", "since the start: under-voltage, throttled"),
        ("throttled=0x50005", "bad", "now: under-voltage, throttled"),
        ("VCHI initialization failed", "unknown", "vcgencmd said"),
    ],
)
def test_the_firmware_s_bits_are_read(said: str, state: str, text: str) -> None:
    """By Raspberry Pi's table: bits 0 to 3 now, 16 to 19 since the start."""
    found = machine.throttled(said)
    assert found.state == state
    assert text in found.said


def test_a_clock_that_was_never_set_is_seen() -> None:
    """A Pi has no clock of its own that goes on without power; ✓ where the kernel says that something sets it."""
    assert machine.clock(1_700_000_000).state == "bad"
    assert machine.clock(1_800_000_000, is_set=True).state == "ok"
    assert machine.clock(1_800_000_000, is_set=False).state == "unknown"


@pytest.mark.parametrize(
    ("package", "wait_s", "said", "remedy"),
    [
        ("raise ValueError('numpy.dtype size changed')", 60.0, "numpy.dtype size changed", "scripts/install"),
        ("import time; time.sleep(60)", 0.2, "no answer within 0.2 s", ""),
    ],
)
def test_a_package_that_cannot_be_imported_stops_the_daemon(
    package: str, wait_s: float, said: str, remedy: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """With the reason that Python gives, from a process of its own; one that hangs would hang the daemon, too."""
    (tmp_path / "libcamera.py").write_text(package)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(machine, "IMPORT_S", wait_s)
    found = machine.picamera2()
    assert (found.state, found.stops_daemon) == ("bad", True)
    assert said in found.said
    assert remedy in found.remedy


@pytest.mark.parametrize(("tool", "said"), [("exec sleep 600", "no answer within 2 s"), ("", "vcgencmd said")])
def test_a_tool_that_hangs_or_says_nothing_does_not_hold_the_page_up(
    tool: str, said: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It is ended, and the line says what is not known."""
    (tmp_path / "vcgencmd").write_text(f"#!/bin/sh\n{tool}\n")
    (tmp_path / "vcgencmd").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setattr(machine, "VCGENCMD_S", 2.0)
    found = machine.throttling()
    assert found.state == "unknown"
    assert said in found.said


def test_a_full_disk_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder that is not there yet is no fault."""
    assert machine.disk(tmp_path / "none").state == "unknown"
    monkeypatch.setattr(machine, "FREE_BYTES", 10**18)
    assert machine.disk(tmp_path).state == "bad"
