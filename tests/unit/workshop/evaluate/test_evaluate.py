"""`ledpi evaluate`: rates of a real panel's recording, told place by place."""

from __future__ import annotations

import csv
import os
from functools import partial
from pathlib import Path

import pytest
import typer
import yaml

from ledpi.cli.evaluate import evaluate
from ledpi.cli.simulate import simulate
from ledpi.config.camera_yaml import camera_yaml_text
from ledpi.core.errors import CalibrationError, ConfigError, LedpiError, RecordingError
from ledpi.core.records import Intrinsics
from tests.builders.command import output_of

APP = typer.Typer()
APP.command()(evaluate)
APP.command()(simulate)

LENS_KEYS = ("fx", "fy", "cx", "cy", "distortion")
ANTIPHASE = ("--set", "panels.phase=antiphase", "--set", "panels.white_hz=1250")
pytestmark = pytest.mark.usefixtures("elsewhere")
run = partial(output_of, APP)


def table(folder: str) -> list[dict[str, str]]:
    """results.csv."""
    with Path(folder, "results.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_frames_of_a_real_panel_fill_the_same_table() -> None:
    """A recording whose panel is known; without truth its ID is judged, with it corners and pose too."""
    run("simulate", "take", "--distance", "0.6", "--angle", "20", "--frames", "14")
    options = ("--recording", "take", "--id", "7", "--distance", "0.6", "--angle", "20")
    run("evaluate", "--out", "truth", *options)
    with pytest.raises(ConfigError, match=r"--id 8: by its truth\.jsonl, take shows 7"):
        run("evaluate", "--out", "truth", "--recording", "take", "--id", "8", "--distance", "0.6")
    os.remove("take/truth.jsonl")
    run("evaluate", "--out", "none", *options)
    run("evaluate", "--out", "none", "--recording", "take", "--id", "8", "--distance", "0.8", "--method", "likelihood")
    soft, stream = (line for line in table("truth") if line["method"] in ("likelihood", "stream_12"))
    assert (soft["suite"], soft["distance_m"], soft["angle_deg"]) == ("recording", "0.6", "20")
    assert (soft["frames"], soft["recognised"], soft["false_ids"]) == ("14", "14", "0")
    assert float(soft["corner_px"]) < 0.3
    assert (stream["frames"], stream["recognised"]) == ("1", "1")
    blind = [line for line in table("none") if line["method"] == "likelihood"]
    assert [(b["distance_m"], b["recognised"], b["false_ids"], b["corner_px"]) for b in blind] == [
        ("0.6", "14", "0", ""),
        ("0.8", "0", "14", ""),
    ]
    page = Path("none/evaluation.md").read_text(encoding="utf-8")
    assert "ledpi evaluate --out DIR --recording take --id 7 --distance 0.6 --angle 20\n" in page


def test_a_lens_that_was_calibrated_at_another_size_is_refused() -> None:
    """For a recording that has none of its own: its poses would be wrong without a word."""
    run("simulate", "take", "--distance", "0.6", "--frames", "1")
    file = Path("take/recording.yaml")
    said = yaml.safe_load(file.read_text(encoding="utf-8"))
    said["camera"] = {key: value for key, value in said["camera"].items() if key not in LENS_KEYS}
    file.write_text(yaml.safe_dump(said), encoding="utf-8")
    lens = Intrinsics(width=1296, height=972, fx=1300.0, fy=1300.0, cx=647.5, cy=485.5)
    Path("camera.yaml").write_text(camera_yaml_text(lens, {}), encoding="utf-8")
    options = ("--recording", "take", "--id", "7", "--distance", "0.6", "--set", "camera.intrinsics=camera.yaml")
    with pytest.raises(CalibrationError, match="was made for pictures of 1296 × 972 pixels"):
        run("evaluate", "--out", "out", *options)


def test_a_picture_that_cannot_be_read_is_named() -> None:
    """Rates of fewer frames than there are would be a lie."""
    run("simulate", "take", "--frames", "2")
    Path("take/frames/000001.png").write_bytes(b"no picture")
    with pytest.raises(RecordingError, match=r"000001\.png"):
        run("evaluate", "--recording", "take", "--id", "7", "--distance", "1")


@pytest.mark.slow
def test_antiphase_is_left_to_those_that_can_read_it() -> None:
    """The paper's method cannot: it has no row, and is refused where it is asked for."""
    run("simulate", "take", "--distance", "0.6", "--frames", "12", *ANTIPHASE)
    options = ("--recording", "take", "--id", "7", "--distance", "0.6")
    run("evaluate", "--out", "real", *options)
    assert {line["method"] for line in table("real")} & {"uemura", "likelihood"} == {"likelihood"}
    with pytest.raises(ConfigError, match=r"--method: uemura distinguishes classes .* they are alike"):
        run("evaluate", "--out", "none", *options, "--method", "uemura")
    assert not Path("none/units.jsonl").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--recording", "nowhere", "--id", "7", "--distance", "1"), "nowhere"),
        (("--recording", "x", "--distance", "1"), "--id: must be given with --recording"),
        (("--recording", "x", "--id", "7"), "--distance: must be given once with --recording"),
        (("--id", "7"), "--recording: must be given: the folder of a real panel's frames; simulated panels are"),
        (("--suite", "wild"), "--suite wild: simulated panels are measured by `python -m evaluation.suites`"),
        (("--recording", "x", "--id", "7", "--set", "panels.colour=red"), "panels.colour"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(arguments: tuple[str, ...], message: str) -> None:
    """And nothing is written."""
    with pytest.raises(LedpiError) as refused:
        run("evaluate", "--out", "out", *arguments)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)
    assert not Path("out/results.csv").exists()
