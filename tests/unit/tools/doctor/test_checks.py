"""`ledpi doctor`: what it finds, what it advises, and when it says that the daemon would run."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tty
from dataclasses import replace
from pathlib import Path

import pytest

from ledpi import __version__
from ledpi.camera.factory import open_camera
from ledpi.cli.doctor import line, verdict
from ledpi.config.settings import load_config
from ledpi.core.records import CameraInfo
from ledpi.diagnosis.diagnose import Note
from ledpi.diagnosis.why_not import Why
from ledpi.simulate.scenes import ov5647_lens
from ledpi.tools.doctor import camera, checks, machine
from ledpi.tools.doctor.checks import configuration, examine
from ledpi.tools.doctor.finding import Finding, bad, ok, unknown
from ledpi.tools.doctor.in_view import findings_of, look
from tests.builders import DEADLINE_S, ROOT
from tests.builders.faults import FAULTS, RIGHT, camera_of, config_of

COMMAND = [sys.executable, "-c", "from ledpi.cli import main; main()", "doctor"]
INFO = CameraInfo(
    width=640, height=480, exposure_us=9969.0, row_time_us=31.748, transfer="linear", frame_length_rows=509
)
NO_CAMERA = ("panels.side_m=0.16", "camera.source=v4l2:/dev/video99", "camera.row_time_us=30")  # found out at once


def doctor(*settings: str, options: tuple[str, ...] = ()) -> subprocess.CompletedProcess[str]:
    given = [part for item in settings for part in ("--set", item)]
    return subprocess.run(
        [*COMMAND, *options, *given], cwd=ROOT, capture_output=True, text=True, check=False, timeout=DEADLINE_S
    )


# ---- The page


def test_without_a_camera_the_page_says_what_to_do() -> None:
    """Each ✗ is followed by a remedy, and the exit status says that the daemon would not run."""
    done = doctor(*NO_CAMERA)
    assert (done.returncode, done.stderr) == (1, "")
    lines = done.stdout.splitlines()
    assert lines[-1].startswith("`ledpi run` would not run: camera")
    bad_lines = [number for number, text in enumerate(lines) if text.startswith("✗")]
    assert any("camera.source: /dev/video99 does not exist" in lines[number] for number in bad_lines)
    assert all("→" in lines[number + 1] for number in bad_lines)


def test_where_all_is_well_the_daemon_would_run() -> None:
    """The simulator and a pty: status 0, and the same as JSON."""
    master, slave = os.openpty()
    tty.setraw(master)
    port = f"serial.port={os.ttyname(slave)}"
    done = doctor("panels.side_m=0.16", "camera.source=simulated", port, options=("--json",))
    os.close(slave)
    os.close(master)
    assert done.returncode == 0, done.stdout
    page = json.loads(done.stdout)
    assert page["would_run"] is True
    assert page["findings"][1]["said"].startswith(f"ledpi {__version__}, Python 3.")
    states = {finding["name"]: finding["state"] for finding in page["findings"]}
    well = {"configuration", "packages", "camera", "exposure", "row time", "panel frequencies", "intrinsics"}
    assert {name for name, state in states.items() if state == "ok"} >= well | {"serial port"}


def test_a_lens_that_is_missing_stops_the_simulator_too() -> None:
    """As with a camera: who tries the configuration out on the simulator hears of it there."""
    given = ("camera.source=simulated", "camera.intrinsics=gone.yaml")
    found = {finding.name: finding for finding in examine(load_config(None, given))}
    assert (found["camera"].state, found["camera"].stops_daemon) == ("bad", True)
    assert "gone.yaml: cannot be read" in found["camera"].said


@pytest.mark.parametrize(
    ("content", "state"), [("format: 1\npanels: {7: {position_m: [4, 1, 1.5], yaw_deg: 180}}\n", "ok"), ("7\n", "bad")]
)
def test_the_map_is_read_as_the_daemon_reads_it(tmp_path: Path, content: str, state: str) -> None:
    """A broken one stops the daemon, and so it does the doctor."""
    (tmp_path / "markers.yaml").write_text(content)
    given = (*NO_CAMERA, f"map={tmp_path / 'markers.yaml'}")
    found = next(finding for finding in examine(load_config(None, given)) if finding.name == "map")
    assert (found.state, found.stops_daemon) == (state, state == "bad")


def test_a_panel_in_the_map_that_no_camera_can_read_is_named(tmp_path: Path) -> None:
    """DICT_4X4_50 has no word 50; the others are found all the same, so the daemon runs."""
    hung = "{position_m: [4, 1, 1.5], yaw_deg: 180}"
    (tmp_path / "markers.yaml").write_text(f"format: 1\npanels: {{49: {hung}, 50: {hung}}}\n")
    given = (*NO_CAMERA, f"map={tmp_path / 'markers.yaml'}")
    found = next(finding for finding in examine(load_config(None, given)) if finding.name == "map")
    assert (found.state, found.stops_daemon) == ("bad", False)
    assert found.said.startswith("50 in ")
    assert found.said.endswith("DICT_4X4_50 has IDs 0 to 49")


def test_a_panel_in_the_map_that_is_not_reported_is_named(tmp_path: Path) -> None:
    """A part of another panel can look like 3, until panels.ids says that there is one."""
    (tmp_path / "markers.yaml").write_text("format: 1\npanels: {3: {position_m: [4, 1, 1.5], yaw_deg: 180}}\n")
    given = (*NO_CAMERA, f"map={tmp_path / 'markers.yaml'}")
    alone, listed = (
        next(finding for finding in examine(load_config(None, (*given, *ids))) if finding.name == "map")
        for ids in ((), ("panels.ids=[3]",))
    )
    assert (alone.state, alone.stops_daemon, listed.state) == ("bad", False, "ok")
    assert (
        "ID 3 is reported only if panels.ids lists it: a part or a reflection of a panel can look the same"
        in alone.said
    )


@pytest.mark.parametrize(
    ("settings", "state", "said"),
    [
        (
            (),
            "ok",
            "IDs 3, 8 to 9, 17, 22, 30, 33, 37, 47 are reported only if panels.ids lists them: a part or a refl",
        ),
        (("panels.ids=[23, 9]",), "ok", "panels.ids: 9, 23; a mirror, window or glossy floor can show 9 where there"),
        (("panels.ids=[23, 3]",), "ok", "panels.ids: 3, 23"),
        (("panels.dictionary=DICT_5X5_50",), "ok", "all of DICT_5X5_50"),
        (("panels.overrides={17: {duty: 0.4}}",), "bad", "panels.overrides: ID 17 is reported only if panels.ids"),
        (("panels.ids=[3]", "panels.overrides={7: {duty: 0.4}}"), "bad", "panels.overrides: ID 7 is reported only if"),
    ],
)
def test_which_ids_are_reported_is_said(settings: tuple[str, ...], state: str, said: str) -> None:
    """One that has an override should be."""
    config = load_config(None, (*NO_CAMERA, *settings))
    found = next(finding for finding in examine(config) if finding.name == "panel IDs")
    assert found.state == state
    assert found.said.startswith(said)


def test_a_broken_configuration_is_the_first_finding(tmp_path: Path) -> None:
    """Nothing else can be looked at."""
    (tmp_path / "config.yaml").write_text("camera: {exposure: 10000}\n")
    done = doctor(options=("--config", str(tmp_path / "config.yaml")))
    assert done.returncode == 1
    assert "exposure" in done.stdout.splitlines()[0]
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(Path("/etc/ledpi/config.yaml").exists(), reason="there is a configuration here")
def test_without_a_configuration_the_page_goes_on(tmp_path: Path) -> None:
    """All else that is missing is told at once; what to do about the configuration comes first."""
    done = subprocess.run(COMMAND, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=DEADLINE_S)
    lines = done.stdout.splitlines()
    assert done.returncode == 1
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


def test_a_missing_controller_does_not_stop_the_daemon(tmp_path: Path) -> None:
    """It is a ✗, but `run` starts without the port and keeps trying."""
    config = load_config(None, ("panels.side_m=0.16", "camera.source=simulated", f"serial.port={tmp_path}/none"))
    findings = {finding.name: finding for finding in examine(config)}
    assert findings["serial port"].state == "bad"
    assert not findings["serial port"].stops_daemon


def test_a_line_has_its_mark_its_name_and_its_remedy() -> None:
    """The remedy on a line of its own."""
    assert line(bad("disk", "full", "delete")) == "✗ disk               full\n                     → delete"


def test_the_last_line_says_what_the_daemon_would_not_do_well() -> None:
    """One ✗ that does not stop it is no reason to say that all is well."""
    port, disk = bad("serial port", "no such file", "set it"), bad("disk", "full", "delete", stops_daemon=True)
    assert verdict([ok("camera", "there")]) == "`ledpi run` would run"
    assert verdict([ok("camera", "there"), port]) == "`ledpi run` would run, but see to its ✗: serial port"
    assert verdict([port, disk]) == "`ledpi run` would not run: disk"


# ---- The camera


def test_an_exposure_that_the_camera_cannot_do_is_not_confirmed() -> None:
    """10 µs are asked for, and a camera of this kind exposes for four rows at least."""
    findings = examine(load_config(None, ("camera.source=simulated", "camera.exposure_us=10")))
    found = next(finding for finding in findings if finding.name == "exposure")
    assert (found.state, found.said) == ("bad", "the camera exposes for 135 µs, where 10 µs were asked for")


def test_an_exposure_of_whole_rows_is_what_was_asked_for() -> None:
    """Makes 296 rows of 10 ms."""
    findings = examine(load_config(None, ("camera.source=simulated",)))
    found = next(finding for finding in findings if finding.name == "exposure")
    assert (found.state, found.said) == ("ok", "9967 µs of 10000 µs asked for")


def test_a_frequency_near_a_null_is_named() -> None:
    """At 10 ms, 1200.3 Hz is 11.97 cycles: hardly a band is left."""
    config = load_config(None, ("panels.side_m=0.16", "panels.black_hz=1204"))
    found = camera.frequencies(config, INFO)
    assert found.state == "bad"
    assert "1204 Hz all but vanishes" in found.said


def test_a_frame_period_that_freezes_the_bands_is_named() -> None:
    """504 rows of 31.748 µs are 20.00 cycles of 1250 Hz; over 509 both classes move."""
    config = load_config(None, ("panels.side_m=0.16",))
    assert camera.frequencies(config, INFO).state == "ok"
    found = camera.frequencies(config, replace(INFO, frame_length_rows=504))
    assert "1250 Hz hardly moves from frame to frame" in found.said


def test_a_lens_that_is_none_is_seen() -> None:
    """The OV5647's is one; a focal length of ten picture widths is not, nor a centre in the corner."""
    lens = ov5647_lens()
    assert camera.plausible(lens, Path("camera.yaml")).state == "ok"
    assert camera.plausible(replace(lens, fx=6400.0, fy=6400.0), Path("camera.yaml")).state == "bad"
    assert camera.plausible(replace(lens, cx=20.0), Path("camera.yaml")).state == "bad"


def test_a_broken_calibration_stops_the_daemon(tmp_path: Path) -> None:
    """As `run` would not start with it."""
    (tmp_path / "camera.yaml").write_text("nothing")
    config = load_config(None, ("panels.side_m=0.16", f"camera.intrinsics={tmp_path}/camera.yaml"))
    found = camera.intrinsics(config, None)
    assert (found.state, found.stops_daemon) == ("bad", True)


def test_the_camera_is_free_again_after_the_look() -> None:
    """Closes what was opened, so that the next one can have it."""
    config = load_config(None, ("panels.side_m=0.16", "camera.source=simulated"))
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


def test_panels_that_are_read_are_named() -> None:
    """Nothing else is told of them."""
    assert in_view("nothing") == [ok("panels", "ID 7, 11 read")]


def test_a_panel_that_is_built_wrongly_is_a_fault() -> None:
    """With what to do; the daemon would run."""
    read, wrong = in_view("swapped")
    assert read == ok("panels", "ID 7 read")
    assert (wrong.state, wrong.stops_daemon, wrong.remedy[:8]) == ("bad", False, "exchange")
    assert "is not read: looks like ID 11 with its two frequencies swapped" in wrong.said


def test_a_light_may_be_none() -> None:
    """So it is no fault; what helps, if it is a panel, is said all the same."""
    light = in_view("saturated")[-1]
    assert (light.state, light.remedy[:9]) == ("unknown", "less gain")
    assert ", if it is a panel: too bright" in light.said


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
    """A Pi has no clock of its own that goes on without power."""
    assert machine.clock(1_700_000_000).state == "bad"
    assert machine.clock(1_800_000_000).state == "ok"


def test_a_package_that_cannot_be_imported_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """With the reason that Python gives, from a process of its own."""
    (tmp_path / "libcamera.py").write_text("raise ValueError('numpy.dtype size changed')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    found = machine.picamera2()
    assert (found.state, found.stops_daemon) == ("bad", True)
    assert "numpy.dtype size changed" in found.said
    assert "scripts/install" in found.remedy


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


def test_an_import_that_hangs_stops_the_daemon(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """As one that fails: the daemon would hang there too."""
    (tmp_path / "libcamera.py").write_text("import time; time.sleep(60)")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(machine, "IMPORT_S", 0.2)
    found = machine.picamera2()
    assert (found.state, found.stops_daemon, found.said) == ("bad", True, "no answer within 0.2 s")


def test_a_full_disk_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder that is not there yet is no fault."""
    assert machine.disk(tmp_path / "none").state == "unknown"
    monkeypatch.setattr(machine, "FREE_BYTES", 10**18)
    assert machine.disk(tmp_path).state == "bad"
