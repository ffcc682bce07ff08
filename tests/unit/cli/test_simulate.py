"""`ledpi simulate` writes recordings that the reader takes, with truth."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from ledpi.camera.recording.picture import read_picture
from ledpi.camera.recording.reader import load_recording
from ledpi.cli.simulate import simulate
from ledpi.core.errors import LedpiError

ROOT = Path(__file__).parents[3]
APP = typer.Typer()
APP.command()(simulate)
pytestmark = pytest.mark.usefixtures("elsewhere")


def run(*arguments: str) -> int:
    """Exit status; a LedpiError comes through, as `main` prints it."""
    result = CliRunner().invoke(APP, list(arguments))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code


def test_it_says_what_it_wrote_and_what_to_do_with_it() -> None:
    """The folder, as a shell takes it."""
    result = CliRunner().invoke(APP, ["my take", "--frames", "1"])
    assert result.stdout == "my take: 1 frame, with the truth; next: ledpi decode 'my take'\n"


def test_the_python_lines_of_the_readme_run_as_printed(capsys: pytest.CaptureFixture[str]) -> None:
    """In the folder of `ledpi simulate take`, with the camera.yaml that it wrote: panel 7, 1 m away."""
    assert run("take", "--frames", "1") == 0
    lines = re.search(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    assert lines is not None
    exec(lines[1], {})
    (found,) = (line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("7 "))
    assert float(found[-1]) == pytest.approx(1.0, rel=0.01)


def test_still_panels_at_a_distance_and_an_angle(tmp_path: Path) -> None:
    """Two panels side by side, 2 m away, exposed for as many whole rows as fit in 150 µs."""
    arguments = ("--distance", "2", "--angle", "-30", "--id", "3", "--id", "9", "--exposure-us", "150")
    assert run("take", "--frames", "3", "--transfer", "linear", *arguments) == 0
    recording = load_recording(tmp_path / "take")
    assert [entry.seq for entry in recording.frames] == [0, 1, 2]
    assert recording.camera.exposure_us == pytest.approx(4 * 1852 / 55)
    assert recording.camera.transfer == "linear"
    assert (recording.dictionary, recording.panel.side_m) == ("DICT_4X4_50", 0.16)
    assert recording.truth is not None
    assert [marker.id for marker in recording.truth[2]] == [3, 9]
    np.testing.assert_allclose(recording.truth[2][0].camera_from_marker.position_m, [-0.12, 0, 2.0], atol=1e-9)


def test_the_same_seed_gives_the_same_recording(tmp_path: Path) -> None:
    """Picture by picture; another seed gives others."""
    for out, seed in (("a", "5"), ("b", "5"), ("c", "6")):
        assert run(out, "--frames", "2", "--seed", seed) == 0
    a, b, c = ((tmp_path / out / "frames/000001.png").read_bytes() for out in "abc")
    assert a == b
    assert a != c


@pytest.mark.slow
def test_the_drive_moves(tmp_path: Path) -> None:
    """Panels 7 and 23 come nearer from frame to frame, and are in the pictures where the truth says."""
    assert run("drive", "--scene", "drive", "--frames", "40") == 0
    recording = load_recording(tmp_path / "drive")
    assert recording.truth is not None
    first, last = recording.truth[0], recording.truth[39]
    assert [marker.id for marker in last] == [7, 23]
    assert last[0].camera_from_marker.position_m[2] < first[0].camera_from_marker.position_m[2] - 0.05
    pixels = np.empty((480, 640), np.uint8)
    assert read_picture(recording.frames[39].picture, pixels) is None
    for marker in last:
        x, y = np.round(marker.corners_px.mean(axis=0)).astype(int)
        assert pixels[y - 5 : y + 6, x - 5 : x + 6].mean() > 1.5 * pixels.mean()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--id", "50"], "--id: DICT_4X4_50 has the IDs 0 to 49, not 50"),
        (["--scene", "drive", "--id", "3"], "--scene drive: --id, --distance and --angle are of still panels"),
        (["--set", "panels.overrides={7: {side_m: 1}}"], "panels.overrides.7"),
        (["--exposure-us", "-3"], "camera.exposure_us"),
        (["--config", "nowhere.yaml"], "nowhere.yaml: cannot be read"),
    ],
)
def test_what_cannot_be_rendered_is_reported_in_one_line(arguments: list[str], message: str) -> None:
    """The option or key that is wrong, and nothing is written."""
    with pytest.raises(LedpiError) as told:
        run("out", *arguments)
    assert message in str(told.value)
    assert "\n" not in str(told.value)
    assert not Path("out").exists()


def test_a_recording_is_never_written_over(tmp_path: Path) -> None:
    """A folder that holds something is left alone."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out/precious.txt").write_text("mine")
    with pytest.raises(LedpiError, match="not empty"):
        run("out")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["precious.txt"]
