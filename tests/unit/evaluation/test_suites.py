"""`python -m evaluation.suites`: the same results however work is shared out, kept when broken off, and told."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from evaluation.suites import plan as plan_module
from evaluation.suites import units as units_module
from evaluation.suites.__main__ import app
from evaluation.suites.conditions import Condition, Suite
from evaluation.suites.draw import Take, draw_take
from evaluation.suites.plan import Plan
from evaluation.suites.units import Unit, code_version, run_unit
from ledpi.camera.recording.reader import load_recording
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import load_config
from ledpi.core.errors import ConfigError, LedpiError
from ledpi.workshop.evaluate.page import source_digest
from tests.builders.command import output_of

SMALL = ("--suite", "paper", "--distance", "1", "--exposure-us", "10000", "--frames", "3")
run = partial(output_of, app)


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Results go to an empty working directory; units are so small that even a short run has several."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(plan_module, "TAKES_A_UNIT", 1)


def table(folder: str) -> list[dict[str, str]]:
    """results.csv, but for the times."""
    with Path(folder, "results.csv").open(newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    return [{name: value for name, value in line.items() if name != "decode_ms"} for line in lines]


@pytest.mark.slow
def test_a_run_goes_on_where_it_was_broken_off() -> None:
    """One unit finished, the next cut off in the middle of its line: only the finished one is not done again."""
    options = (*SMALL, "--method", "likelihood", "--workers", "1")
    run("--out", "out", *options)
    units = Path("out/units.jsonl")
    lines = units.read_text(encoding="utf-8").splitlines(keepends=True)
    assert len(lines) == 3
    whole = table("out")
    first = json.loads(lines[0])
    first["rows"]["likelihood"]["corner_px"] = [77.0] * 5  # so that one sees that it is taken as it is
    units.write_text(json.dumps(first) + "\n" + lines[1][:40], encoding="utf-8")
    run("--out", "out", *options)
    again = units.read_text(encoding="utf-8").splitlines()
    assert [json.loads(line)["unit"] for line in again] == [json.loads(line)["unit"] for line in lines]
    assert table("out")[0]["corner_px"] == "77"
    assert table("out")[0] | {"corner_px": ""} == whole[0] | {"corner_px": ""}
    run("--out", "out", *options)
    assert units.read_text(encoding="utf-8").splitlines() == again


@pytest.mark.slow
def test_other_settings_go_to_another_folder() -> None:
    """Results of two kinds are never mixed, nor is anything else written over; a run without any blocks nothing."""
    run("--out", "out", *SMALL, "--method", "aruco")
    with pytest.raises(ConfigError, match=r"out/settings\.json: seed: the results here are of 1, asked for is 2"):
        run("--out", "out", *SMALL, "--method", "aruco", "--seed", "2")
    Path("mine").mkdir()
    Path("mine/thesis.txt").write_text("do not touch", encoding="utf-8")
    with pytest.raises(ConfigError, match="--out mine: holds other things"):
        run("--out", "mine", *SMALL)
    for path in Path("out").iterdir():
        if path.name != "settings.json":
            path.unlink()
    run("--out", "out", *SMALL, "--method", "aruco", "--seed", "2")
    assert json.loads(Path("out/settings.json").read_text())["seed"] == 2


@pytest.mark.slow
def test_the_page_shows_tables_plots_and_the_command() -> None:
    """Beside every table the command that gives it again; each picture that is linked is there."""
    run("--out", "out", *SMALL, "--angle", "45", "--method", "aruco", "--roll")
    page = Path("out/evaluation.md").read_text(encoding="utf-8")
    command = "--out DIR --suite paper --frames 3 --seed 1 --transfer srgb --exposure-us 10000"
    assert f"python -m evaluation.suites {command} --distance 1 --angle 45 --method aruco --roll\n" in page
    assert "| 1 m, 45° | 100 % (43.9–100.0) |" in page
    pytest.importorskip("matplotlib", reason="matplotlib is not installed (extra: evaluate)")
    assert "(rates-10000us-srgb.png)" in page
    assert Path("out/rates-10000us-srgb.png").read_bytes().startswith(b"\x89PNG")


PLAIN = Condition(suite="paper", distance_m=0.8, angle_deg=0.0, any_roll=False)
UNIT = Unit(
    seed=1,
    condition=PLAIN,
    first_take=0,
    takes=1,
    methods=("likelihood", "stream"),
    panels=PanelSettings(side_m=0.16),
    code=code_version(),
)


def test_a_decoy_that_is_read_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """A decoy that shows a word, which no drawn one does, is a false ID in each of 12 frames: zero means something."""

    def word_without_truth(*of: object) -> Take:
        take = draw_take(PLAIN, UNIT.panels, 1, 0)
        return replace(take, scene=replace(take.scene, panels=(replace(take.scene.panels[0], marker_id=None),)))

    monkeypatch.setattr(units_module, "draw_take", word_without_truth)
    rows = run_unit(replace(UNIT, condition=replace(PLAIN, suite="decoys", case="mirrored")))["rows"]
    assert {row: (tally["frames"], tally["false_ids"]) for row, tally in rows.items()} == {
        "likelihood": (12, 12),
        "stream_all": (12, 12),
    }
    assert rows["likelihood"]["false"][3].startswith("take 0, frame 3: ID ")


def a_plan(suite: Suite, case: str, *set_: str) -> Plan:
    return Plan(
        suites=(suite,),
        frames=12,
        seed=1,
        cases=(case,),
        methods=("likelihood", "stream"),
        apriltag=False,
        panels=load_config(None, ("panels.side_m=0.16", *set_)).panels,
        code=code_version(),
    )


@pytest.mark.parametrize(("case", "searched"), [("oscillators off by 1 %", True), ("plain", False)])
def test_where_oscillators_are_off_frequencies_are_sought(case: str, searched: bool) -> None:
    """As who has such panels would configure it; elsewhere as it is configured."""
    assert {unit.panels.search_frequencies for unit in a_plan("robustness", case).units()} == {searched}
    (unit, *_) = a_plan("robustness", case, "panels.search_frequencies=true").units()
    assert unit.panels.search_frequencies


@pytest.mark.parametrize("changed", ["reading.py", "kernels/loop.c", "kernels/loop.h"])
def test_code_that_changes_results_changes_the_code_version(tmp_path: Path, changed: str) -> None:
    """A run does not go on with other Python code or compiled loops, nor does a worker with other code help."""
    sources = {tmp_path / name: b"" for name in ("reading.py", "kernels/loop.c", "kernels/loop.h", "kernels/loop.so")}
    (tmp_path / "kernels").mkdir()
    for path, text in sources.items():
        path.write_bytes(text)
    before = source_digest(tmp_path)
    (tmp_path / "kernels" / "loop.so").write_bytes(b"compiled on another machine")
    assert source_digest(tmp_path) == before
    (tmp_path / changed).write_bytes(b"changed")
    assert source_digest(tmp_path) != before
    with pytest.raises(ConfigError, match="a worker runs other code"):
        run_unit(replace(UNIT, code="another"))


@pytest.fixture
def cluster() -> Iterator[str]:
    """The address of a dask.distributed scheduler with one worker of its own."""
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed (extra: suites)")
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as local:
        yield local.scheduler_address


@pytest.mark.filterwarnings("ignore")  # distributed's own
@pytest.mark.slow
def test_a_cluster_gives_the_same_results(cluster: str) -> None:
    """The same units on a dask.distributed worker, and on processes of our own."""
    options = (*SMALL, "--method", "likelihood", "--method", "aruco")
    run("--out", "there", *options, "--scheduler", cluster)
    run("--out", "here", *options)
    assert table("there") == table("here")


def test_a_take_becomes_a_recording_to_look_at() -> None:
    """With its truth, and as the driver describes it, which its frames' times correct."""
    where = ("--suite", "robustness", "--case", "row time misreported by 6 %", "--distance", "1")
    run("--out", "take", *where, "--take", "3")
    recording = load_recording(Path("take"))
    assert len(recording.frames) == 12
    assert "row_time_us: 33.67" in Path("take/recording.yaml").read_text(encoding="utf-8")
    assert recording.camera.row_time_us == pytest.approx(31.75, abs=0.01)
    assert recording.truth is not None
    assert len(recording.truth[11]) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--case", "fog"), "--case fog: paper has only: plain"),
        (("--take", "0"), "--take: is of one condition, asked for are 30"),
        (("--set", "panels.colour=red"), "panels.colour"),
        (("--suite", "decoys", "--method", "aruco"), "--method aruco: prints are for "),
    ],
)
def test_what_cannot_be_is_said_in_one_line(arguments: tuple[str, ...], message: str) -> None:
    """And nothing is written."""
    with pytest.raises(LedpiError) as refused:
        run("--out", "out", "--suite", "paper", *arguments)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)
    assert not Path("out/results.csv").exists()
