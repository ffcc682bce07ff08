"""`ledpi calibrate panel` and `shutter`, from a simulated recording to config.yaml."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from datetime import date, timedelta
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from ledpi.camera.simulate.scenes import still_scene
from ledpi.camera.simulated import SimulatedCamera, simulated_sensor
from ledpi.config.camera_yaml import camera_yaml_text
from ledpi.config.settings import load_config
from ledpi.core.errors import CalibrationError
from ledpi.core.records import Frame, Intrinsics, Pixels
from ledpi.workshop.calibrate.files import change_config, changed_yaml
from ledpi.workshop.calibrate.taking import settle_gain
from tests.builders.command import Run

Simulated = Callable[..., Path]

CONFIG = """\
# my robot
camera:
    row_time_us: auto   # the driver's
panels:
    side_m: 0.16   # measured twice
    overrides: {3: {side_m: 0.3}}
map: null
"""


@pytest.fixture
def command(ledpi: Run) -> Run:
    """Runs `ledpi …` in a folder with CONFIG."""
    Path("config.yaml").write_text(CONFIG, encoding="utf-8")
    return ledpi


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """60 frames of panel 7 at 1 m, by settings; each recording is simulated once."""

    @cache
    def take(*settings: str) -> Path:
        folder = tmp_path_factory.mktemp("drawn") / "take"
        overrides = [part for setting in ("panels.side_m=0.16", *settings) for part in ("--set", setting)]
        simulate = [sys.executable, "-m", "ledpi", "simulate", str(folder), "--distance", "1", "--frames", "60"]
        subprocess.run([*simulate, *overrides], check=True, capture_output=True)
        return folder

    return take


@pytest.fixture
def simulated(drawn: Callable[..., Path], command: Run) -> Simulated:
    """A copy in the working directory, which tells other values than those that were simulated."""
    return lambda *settings, claimed: copied(drawn(*settings), claimed)


def copied(drawn: Path, claimed: dict[str, dict[str, float]]) -> Path:
    shutil.copytree(drawn, "take")
    header = Path("take/recording.yaml")
    values = yaml.safe_load(header.read_text())
    for section, keys in claimed.items():
        values[section] |= keys
    header.write_text(yaml.safe_dump(values))
    return Path("take")


ANNOUNCED = {"panel": {"black_hz": 1250.0, "white_hz": 2450.0}}


@pytest.mark.parametrize("claimed", [ANNOUNCED, {}], ids=["announced wrongly", "known to the recording alone"])
def test_a_panel_that_is_off_is_measured_and_written(command: Run, simulated: Simulated, claimed: Any) -> None:
    """1262 and 2431 Hz, configured as 1250 and 2450: in panels.overrides to 0.1 %, and nothing else is touched."""
    take = simulated("panels.black_hz=1262", "panels.white_hz=2431", claimed=claimed)
    status, out, err = command("calibrate", "panel", take)
    assert (status, err) == (0, "")
    assert "panel 7: " in out
    assert "blinks as configured" not in out
    assert "config.yaml: panels.overrides written; the older one is kept as config.yaml.bak-1" in out
    assert Path("config.yaml.bak-1").read_text(encoding="utf-8") == CONFIG
    spec = load_config(Path("config.yaml")).panels.spec(7)
    assert spec.black_hz == pytest.approx(1262.0, rel=1e-3)
    assert spec.white_hz == pytest.approx(2431.0, rel=1e-3)
    written = Path("config.yaml").read_text(encoding="utf-8")
    assert "# my robot" in written
    assert "# measured twice" in written
    assert yaml.safe_load(written)["panels"]["overrides"][3] == {"side_m": 0.3}


@pytest.mark.slow
def test_a_duty_that_is_off_by_noise_is_not_written(command: Run, simulated: Simulated) -> None:
    """The panel is off in frequency; of its duty 0.502 would be measured, where 0.5 is announced."""
    given = ("panels.black_hz=1262", "panels.white_hz=2431", "panels.duty=0.502", "camera.exposure_us=1000")
    take = simulated(*given, claimed=ANNOUNCED)
    status, out, _ = command("calibrate", "panel", take)
    assert status == 0
    assert "duty   0.50" in out
    override = load_config(Path("config.yaml")).panels.overrides[7]
    assert override.black_hz == pytest.approx(1262.0, rel=1e-3)
    assert override.duty is None
    assert command("panel", "firmware", "--id", 7, "--black", 1250, "--white", 2450, "--out", "driver")[0] == 0


@pytest.mark.slow
def test_one_picture_over_and_over_is_refused(command: Run, simulated: Simulated) -> None:
    """A camera that hangs, or frames copied by hand: nothing moves, so nothing can be measured."""
    take = simulated(claimed={})
    first = (take / "frames/000000.png").read_bytes()
    for picture in sorted((take / "frames").iterdir()):
        picture.write_bytes(first)
    status, _, err = command("calibrate", "panel", take)
    assert status == 2
    assert err.startswith("ledpi: all frames show the very same light")


@pytest.mark.slow
def test_a_panel_with_an_entry_is_sought_around_it(command: Run, simulated: Simulated) -> None:
    """ID 7 is announced as 1500 and 2800 Hz by itself; it is found there, although the common ones are far off."""
    overrides = ("camera.exposure_us=1000", "panels.black_hz=1507", "panels.white_hz=2790")
    take = simulated(*overrides, claimed={"panel": {"black_hz": 1000.0, "white_hz": 2000.0}})
    entry = ("--set", "panels.overrides.7.black_hz=1500", "--set", "panels.overrides.7.white_hz=2800")
    status, out, _ = command("calibrate", "panel", take, "--dry-run", *entry)
    assert status == 0
    assert "black  1507.0" in out
    assert "(+0.47% of 1500)" in out


@pytest.mark.slow
def test_a_row_time_that_the_driver_misreports_is_written(command: Run, simulated: Simulated) -> None:
    """31.75 µs, reported as 33.67: in camera.row_time_us to 0.2 %, and noted with the lens; by a dry run nowhere."""
    calibrated_lens(640, 480)
    before = Path("config.yaml").read_text(encoding="utf-8")
    take = simulated("camera.row_time_us=31.75", claimed={"camera": {"row_time_us": 33.67}})
    assert command("calibrate", "shutter", take, "--dry-run")[0] == 0
    assert Path("config.yaml").read_text(encoding="utf-8") == before
    status, out, _ = command("calibrate", "shutter", take)
    assert status == 0
    assert "the driver misreports its row time by +6.0%" in out
    assert load_config(Path("config.yaml")).camera.row_time_us == pytest.approx(31.75, rel=2e-3)
    assert re.search(r"shutter .*; measured 31\.7", command("calibrate")[1])


@pytest.mark.slow
def test_of_a_panel_that_is_as_announced_the_day_is_noted(command: Run, simulated: Simulated) -> None:
    """And no frequencies, which would cost decoding time."""
    take = simulated(claimed={})
    assert "panel 7 blinks as configured" in command("calibrate", "panel", take)[1]
    panels = load_config(Path("config.yaml")).panels
    assert panels.overrides[7].measured == date.today()
    assert panels.spec(7) == panels.spec()


def calibrated_lens(width: int, height: int, **notes: dict[str, float | date]) -> None:
    """A camera.yaml that is three days old and that config.yaml names."""
    lens = Intrinsics(width=width, height=height, fx=643.0, fy=643.0, cx=width / 2, cy=height / 2)
    own = {"calibrated": date.today() - timedelta(days=3), "rms_px": 0.114, "views": 18, "deviations": {"fx": 2.6}}
    Path("camera.yaml").write_text(camera_yaml_text(lens, own | notes))
    Path("config.yaml").write_text(CONFIG.replace("# the driver's", "\n    intrinsics: camera.yaml"), encoding="utf-8")


def test_bare_it_says_what_there_is_and_what_comes_next(command: Run) -> None:
    """A lens, with its quality and age; then the shutter; a panel; and the map."""

    def told() -> tuple[str, str]:
        status, out, _ = command("calibrate")
        assert status == 0
        return out, out.splitlines()[-1]

    out, then = told()
    assert "camera   no camera.intrinsics: IDs, but no poses" in out
    assert then.startswith("next: ledpi calibrate camera (a board to print: ")
    calibrated_lens(1296, 972)
    out, then = told()
    assert "was made for pictures of 1296 × 972 pixels" in out
    assert then.startswith("next: ledpi calibrate camera")
    calibrated_lens(640, 480)
    out, then = told()
    assert "640 × 480, rms 0.114 px of 18 views, fx 643.0 ± 2.6 px, 3 days old" in out
    assert then.startswith("next: ledpi calibrate shutter")
    calibrated_lens(640, 480, shutter={"row_time_us": 33.67, "row_time_sigma_us": 0.002, "measured": date.today()})
    out, then = told()
    assert "measured 33.67" in out
    assert then.startswith("next: ledpi calibrate panel")
    text = Path("config.yaml").read_text(encoding="utf-8")
    today = f"overrides: {{7: {{measured: {date.today()}}}, "
    Path("config.yaml").write_text(text.replace("overrides: {", today), encoding="utf-8")
    out, then = told()
    assert "7: as announced, of today; others not measured" in out
    assert then.startswith("next: ledpi calibrate map")


@pytest.mark.slow
@pytest.mark.parametrize("what", ["panel", "shutter"])
def test_what_moves_or_is_short_is_refused(command: Run, what: str) -> None:
    """A robot that drives, and a recording of too few frames: one line, exit status 2, nothing written."""
    command("simulate", "drive", "--scene", "drive", "--frames", 21)
    command("simulate", "short", "--frames", 5)
    for take, why in (("drive", "no lit square stands still in view"), ("short", "5 usable frames in a row")):
        status, _, err = command("calibrate", what, take)
        assert (status, err.count("\n")) == (2, 1)
        assert why in err
    assert Path("config.yaml").read_text(encoding="utf-8") == CONFIG
    assert not Path("config.yaml.bak-1").exists()


@pytest.mark.parametrize("arguments", [("camera", "pictures"), ("shutter",), ("panel",), ("map", "drive")])
def test_a_configuration_that_cannot_be_written_is_reported_before_anything_is_measured(
    command: Run, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    """Its name is so long that no new file can stand beside it; pictures, camera and drive are not even there."""
    file = tmp_path / ("c" * 250)
    text = "panels: {side_m: 0.16}\ncamera: {source: 'v4l2:/dev/video99', row_time_us: 30}\n"
    file.write_text(text)
    status, _, err = command("calibrate", *arguments, "--config", file)
    assert (status, err) == (2, f"ledpi: {file}: cannot be written: File name too long\n")
    assert file.read_text() == text


def test_a_key_is_changed_and_comments_stay(tmp_path: Path) -> None:
    """Also where the section is not there yet. A configuration that went away is an error with its name."""
    text = changed_yaml(CONFIG, {("camera", "row_time_us"): 31.75, ("serial", "baud"): 9600})
    assert "row_time_us: 31.75 " in text
    assert "# the driver's" in text
    assert "map: null" in text
    assert yaml.safe_load(text)["serial"] == {"baud": 9600}
    with pytest.raises(CalibrationError, match=r"gone\.yaml: cannot be read: No such file"):
        change_config(tmp_path / "gone.yaml", {("camera", "row_time_us"): 1.0})


class TooBrightCamera(SimulatedCamera):
    """One whose pictures are as bright as its gain makes them: a panel that saturates at the gain it starts with."""

    gain_limits = (1.0, 16.0)
    gain = 4.0

    def set_gain(self, gain: float) -> None:
        self.gain = gain

    def read(self, into: Pixels) -> Frame | None:
        frame = super().read(into)
        if frame is None:
            return None
        bright = np.minimum(frame.pixels * self.gain, 255).astype(np.uint8)
        return replace(frame, pixels=bright, analogue_gain=self.gain)


@pytest.mark.slow
def test_the_gain_settles_on_the_panel_before_frames_are_taken() -> None:
    """Brings a panel that is too bright below full scale, where the configuration leaves the gain open."""
    config = load_config(None, ("panels.side_m=0.16", "camera.transfer=linear"))
    sensor = simulated_sensor(config.camera, config.panels)
    scene = still_scene(sensor, {7: config.panels.spec()}, "DICT_4X4_50", distance_m=1.0, angle_deg=0.0)
    camera = TooBrightCamera(scene, seed=0, paced=False, frames=60)
    settle_gain(camera, config.panels)
    frame = camera.read(np.empty((480, 640), np.uint8))
    assert frame is not None
    assert 1 / 6 < np.percentile(frame.pixels[200:280, 280:360], 99) / 255 < 0.75
