"""scripts/demo.py: it judges poses by the picture that they are from, ends by itself, and says how it went."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from ledpi.camera.recording.reader import TruthMarker
from ledpi.camera.simulated import SimulatedCamera, open_simulated, simulated_sensor
from ledpi.config.settings import Config, load_config
from tests.builders import ROOT

alone = pytest.mark.alone  # it tells how late a daemon is: no other test may take the processor meanwhile

HUNG_S = 600.0  # by then it does not end at all: how fast it is, is no matter here
AGE_US = 31_000
PERIOD_US = 507 * 1852 / 55  # of the simulated sensor's frames


@pytest.fixture(scope="module")
def demo() -> Iterator[ModuleType]:
    spec = importlib.util.spec_from_file_location("demo", ROOT / "scripts" / "demo.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["demo"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["demo"]


@pytest.fixture(scope="module")
def config() -> Config:
    return load_config(None, ("panels.side_m=0.16", "camera.source=simulated"))


@pytest.fixture(scope="module")
def camera(config: Config) -> SimulatedCamera:
    return open_simulated(config, paced=False)


def judged(demo: ModuleType, config: Config, camera: SimulatedCamera, *, seq: int, marker_id: int, late_us: int) -> Any:
    """The tally of one packet that is exactly true of panel 7 in frame `seq`, but says `marker_id`, and comes late."""
    seven = true_seven(camera, seq)
    centre_row = float(seven.corners_px[:, 1].mean())
    sensor = simulated_sensor(config.camera, config.panels)
    exposed_ns = round(1e9 * sensor.mid_exposure_s(seq, centre_row))
    position_m = seven.camera_from_marker.position_m.tolist()
    message = {"id": marker_id, "position_m": position_m, "age_us": AGE_US}
    tally = demo.Tally()
    demo.judge(message, exposed_ns + 1000 * (AGE_US + late_us), demo.Truth(config), tally)
    return tally


def true_seven(camera: SimulatedCamera, seq: int) -> TruthMarker:
    return next(marker for marker in camera.truth(seq) if marker.id == 7)


@pytest.mark.parametrize("late_us", [-1_500, 0, 1_000, 14_000])
def test_a_pose_is_set_beside_its_own_picture(
    late_us: int, demo: ModuleType, config: Config, camera: SimulatedCamera
) -> None:
    """However late a packet passes, within most of a frame's period: a true pose is off by nothing."""
    tally = judged(demo, config, camera, seq=100, marker_id=7, late_us=late_us)
    assert (dict(tally.right), tally.wrong) == ({7: 1}, 0)
    assert tally.errors_m == [0.0]


def test_a_pose_of_the_next_picture_is_not_that_of_this_one(
    demo: ModuleType, config: Config, camera: SimulatedCamera
) -> None:
    """The robot moves: a packet that is a whole period late is judged by the next picture, and found off by the way."""
    tally = judged(demo, config, camera, seq=100, marker_id=7, late_us=round(PERIOD_US))
    before_m, after_m = (true_seven(camera, seq).camera_from_marker.position_m for seq in (100, 101))
    moved_m = float(np.linalg.norm(after_m - before_m))
    assert moved_m > 0.005
    assert tally.errors_m == pytest.approx([moved_m])


@pytest.mark.parametrize("marker_id", [23, 5], ids=["the other panel's", "nobody's"])
def test_a_wrong_id_at_a_right_place_is_wrong(
    marker_id: int, demo: ModuleType, config: Config, camera: SimulatedCamera
) -> None:
    """Panel 7 is there, whatever else is in view."""
    tally = judged(demo, config, camera, seq=100, marker_id=marker_id, late_us=0)
    assert (tally.right.total(), tally.wrong) == (0, 1)


def processes_with(mark: str) -> list[str]:
    """The processes that have inherited an environment with this mark."""
    found = []
    for environment in Path("/proc").glob("[0-9]*/environ"):
        with suppress(OSError):
            if mark.encode() in environment.read_bytes():
                found.append(environment.parent.name)
    return found


def run(out: Path, mark: str, *options: str) -> subprocess.CompletedProcess[str]:
    # As a shell starts its background jobs, which must end by themselves, too: with SIGINT ignored.
    ignoring = ["sh", "-c", 'trap "" INT; exec "$@"', "sh"]
    command = [*ignoring, sys.executable, "scripts/demo.py", "--out", str(out), *options]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "LEDPI_TEST_MARK": mark}
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=HUNG_S, check=False
    )


@pytest.mark.slow
@alone
def test_the_demo_runs_by_itself(tmp_path: Path) -> None:
    """Daemon, serial line, monitor: poses beside the truth, a picture, one line of summary, and nothing left behind."""
    for seconds in ("1.5", "6", "24"):  # where the machine is so busy that no pose arrives in time, longer
        done = run(tmp_path, str(tmp_path), "--seconds", seconds)
        if "no pose arrived" not in done.stderr:
            break
    assert (done.returncode, done.stderr) == (0, "")
    poses = [line for line in done.stdout.splitlines() if re.match(r" +\d+\.\d s  +\d+ ", line)]
    assert {line.split()[2] for line in poses} == {"7", "23"}
    assert re.search(r"^open http://127\.0\.0\.1:\d+/#token=\S+ in a browser", done.stdout, re.MULTILINE)
    summary = re.search(
        r"^(\d+) frames, (\d+) markers, (\d+) right IDs, 0 wrong IDs, "
        r"median position error [\d.]+ mm \(([\d.]+) % of the distance\), (\d+) packets, 0 lost, 0 bad$",
        done.stdout,
        re.MULTILINE,
    )
    assert summary is not None
    assert "Next, in this folder:" in done.stdout[summary.end() :]
    frames, markers, right, packets = (int(summary[i]) for i in (1, 2, 3, 5))
    assert 0 < right == markers <= 2 * frames
    assert packets > markers  # there are status packets too
    assert float(summary[4]) < 2.0
    assert cv2.imread(str(tmp_path / "snapshot.png")) is not None
    assert processes_with(str(tmp_path)) == []


def test_a_computer_that_is_too_slow_is_reported(
    demo: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """All went well, but every pose was too old to be sent: the reason is said, and the status is 1."""
    ended = SimpleNamespace(returncode=0, wait=lambda _: 0, stdout=None)
    (tmp_path / "monitor.log").touch()
    monkeypatch.setattr(demo, "running", lambda *_: nullcontext(ended))
    monkeypatch.setattr(demo, "watch", lambda *_: demo.Tally(frames=8))
    monkeypatch.setattr(demo, "draw_picture", lambda _: True)
    monkeypatch.setattr(sys, "argv", ["demo.py", "--out", str(tmp_path)])
    monkeypatch.setattr(demo.signal, "signal", lambda *_: None)  # pytest's own handlers stay
    assert demo.main() == 1
    assert "no pose arrived: this computer is busy, or too slow" in capsys.readouterr().err


def test_a_computer_that_is_too_slow_is_told_while_the_demo_runs(demo: ModuleType) -> None:
    """After 5 s of nothing but dropped poses, once; not where no panel is in view; and again after a pose."""
    status = [(s, {"message": "status", "packets_dropped": max(0, s - 6) if s < 20 else s}) for s in range(40)]
    pose = [(25, {"message": "marker"})]
    pace = demo.Pace()
    assert [s for s, message in sorted([*status, *pose], key=lambda each: each[0]) if pace.is_too_slow(message, s)] == [
        7,
        30,
    ]


@pytest.mark.slow
def test_a_daemon_that_fails_is_reported(
    demo: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing to show, so it ends at once, with status 1 and the place of the logs."""
    monkeypatch.setattr(demo, "OPTIONS", ("--config", "config.yaml", "--set", "camera.source=recording:nowhere"))
    monkeypatch.setattr(sys, "argv", ["demo.py", "--out", str(tmp_path)])
    monkeypatch.setattr(demo.signal, "signal", lambda *_: None)  # pytest's own handlers stay
    assert demo.main() == 1
    printed = capsys.readouterr()
    assert printed.out.splitlines()[-1].startswith("0 frames, 0 markers, 0 right IDs, 0 wrong IDs, ")
    assert printed.err == f"ledpi run or ledpi monitor failed: see {tmp_path}/run.log and {tmp_path}/monitor.log\n"
    assert "nowhere/recording.yaml: is missing" in (tmp_path / "run.log").read_text()
