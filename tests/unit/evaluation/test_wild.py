"""The suite `wild`: everything drawn at once, from a seed; beside it a reader given the true corners, and prints."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from evaluation.accuracy.bound import Bound, bound_of
from evaluation.suites.__main__ import app
from evaluation.suites.draw import Take
from evaluation.suites.readers import read_with_oracle
from evaluation.suites.units import photographed
from evaluation.suites.wild import draw_wild
from evaluation.suites.wild_rows import TAKE_SPANS, WILD, drawn
from ledpi.camera.recording.reader import load_recording
from ledpi.camera.simulate.render import scene_truth
from ledpi.config.panels import PanelSettings
from ledpi.core.errors import ConfigError, LedpiError, RecordingError
from ledpi.core.records import Frame
from tests.builders.command import output_of

pytest.importorskip("scipy", reason="scipy is not installed (extra: suites)")

PANELS = PanelSettings(side_m=0.16)
TAKES = range(64)
run = partial(output_of, app)


@pytest.fixture(scope="module")
def takes() -> dict[str, list[Take]]:
    return {row: [draw_wild(row, PANELS, 3, number) for number in TAKES] for row in WILD}


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five takes of two rows as recordings: two cameras each."""
    out = tmp_path_factory.mktemp("kept")
    run("--suite", "wild", "--keep", str(out), "--frames", "5", "--seed", "3", "--case", "near", "--case", "mid")
    return out


def frames_of(take: Take, count: int) -> list[Frame]:
    return list(photographed(take, take.scene, count))


@pytest.mark.slow
@pytest.mark.parametrize("row", WILD)
def test_a_panel_stands_where_its_row_says(row: str, takes: dict[str, list[Take]]) -> None:
    """At such a distance, turned by such an angle to either side, at any roll, wholly in view."""
    near, far = WILD[row].distance_m
    least, most = WILD[row].yaw_deg
    sides = set()
    for take in takes[row]:
        (panel,) = take.scene.panels
        pose = panel.motion.scene_from_body(0.0)
        away_m = float(np.linalg.norm(pose[:3, 3]))
        assert near - 1e-9 <= away_m <= far + 1e-9
        cosine = float(-pose[:3, 2] @ pose[:3, 3]) / away_m
        assert least - 0.01 <= math.degrees(math.acos(cosine)) <= most + 0.01
        sides.add(np.sign(pose[0, 2]))
        (truth,) = scene_truth(take.scene, 0)
        assert not truth.optional
    assert sides == {-1.0, 1.0}


@pytest.mark.slow
def test_only_ids_that_exist_are_drawn(takes: dict[str, list[Take]]) -> None:
    """Without panels.ids none that a part of another panel can show; with it these alone."""
    shown = {take.scene.panels[0].marker_id for own in takes.values() for take in own}
    assert shown == PANELS.existing_ids()
    two = PanelSettings(side_m=0.16, ids=(3, 7))
    assert {draw_wild("near", two, 3, number).scene.panels[0].marker_id for number in range(8)} == {3, 7}


@pytest.mark.slow
def test_who_is_reported_the_corners_reads_the_panel(takes: dict[str, list[Take]]) -> None:
    """A single frame by itself, a stream by all frames until then; other corners, or none that fit, tell nothing."""
    take = next(t for t in takes["mid"] if t.scene.panels[0].appearance.gap < 0.05 and t.peak_level > 0.5)
    lens, spec = take.scene.sensor.intrinsics, PANELS.spec()
    corners_px = scene_truth(take.scene, 0)[0].corners_px
    views = [(frame, corners_px) for frame in frames_of(take, 4)]
    shown = take.scene.panels[0].marker_id
    assert read_with_oracle(views, lens, "DICT_4X4_50", spec)[-1] == shown
    beside = [(frame, corners_px + 70.0) for frame, corners_px in views]
    assert read_with_oracle(beside, lens, "DICT_4X4_50", spec) == [None] * 4
    turned = [(frame, np.roll(corners_px, 1, axis=0)) for frame, corners_px in views]
    assert read_with_oracle(turned, lens, "DICT_4X4_50", spec) == [None] * 4


@pytest.mark.slow
def test_takes_are_kept_as_recordings_with_truth(kept: Path) -> None:
    """One for each camera; a take's frames until the last that is judged, then a gap that no track survives."""
    assert sorted(path.name for path in kept.iterdir()) == ["mid00", "mid01", "near00", "near01"]
    recording = load_recording(kept / "mid00")
    assert [entry.seq for entry in recording.frames] == list(range(4 * 5))
    starts = [entry.row0_readout_ns for entry in recording.frames]
    assert [later - earlier > 500_000_000 for earlier, later in itertools.pairwise(starts)].count(True) == 3
    assert recording.truth is not None
    shown = [recording.truth[5 * number][0] for number in range(4)]
    for number, truth in enumerate(shown):
        take = draw_wild("mid", PANELS, 3, number)
        np.testing.assert_allclose(truth.corners_px, scene_truth(take.scene, 0)[0].corners_px, atol=1e-6)
        assert recording.camera.row_time_us == pytest.approx(take.scene.sensor.row_time_us)
    lines = (kept / "near00" / "drawn.jsonl").read_text(encoding="utf-8").splitlines()
    assert json.loads(lines[2])["gap"] == pytest.approx(drawn(TAKE_SPANS, "near", 3, 2)["gap"], rel=1e-3)


@pytest.mark.slow
def test_the_bound_on_recordings_counts_what_is_judged(kept: Path, tmp_path: Path) -> None:
    """Frames alone, or all but the first of each take; without truth there is none."""
    near, mid = load_recording(kept / "near00"), load_recording(kept / "mid00")
    assert bound_of(near, single=True).total == 4
    late = bound_of(mid, single=False, skip=3)
    assert late.total == 4 * 2
    assert late.read >= 6
    assert late.wrong == 0
    with pytest.raises(RecordingError, match=r"has no truth\.jsonl"):
        bound_of(replace(near, truth=None), single=True)


@pytest.mark.slow
def test_an_id_that_is_not_there_is_wrong(kept: Path) -> None:
    """The bound holds what is read against the truth: where that names another panel, all that is read is wrong."""
    near = load_recording(kept / "near00")
    assert near.truth is not None
    others = {seq: (replace(markers[0], id=(markers[0].id + 1) % 50),) for seq, markers in near.truth.items()}
    right, wrong = bound_of(near, single=True), bound_of(replace(near, truth=others), single=True)
    assert right.read >= 3
    assert wrong == Bound(read=0, wrong=right.read, total=4)


@pytest.mark.slow
def test_a_short_run_tells_all_three(tmp_path: Path) -> None:
    """Two takes a row: ledpi, a reader given the true corners, and the print, in the frames that the row judges."""
    out = run("--suite", "wild", "--frames", "2", "--out", str(tmp_path / "out"), "--workers", "1")
    lines = [line.split() for line in out.splitlines() if line.startswith("wild,")]
    assert {line[1].rstrip(",") for line in lines} == set(WILD)
    assert len(lines) == 3 * len(WILD)
    page = (tmp_path / "out" / "evaluation.md").read_text(encoding="utf-8")
    assert "|  | ledpi | true corners given | printed ArUco, OpenCV |" in page
    assert "python -m evaluation.suites --out DIR --suite wild --frames 2 --seed 1\n" in page
    table = (tmp_path / "out" / "results.csv").read_text(encoding="utf-8").splitlines()
    columns = table[0].split(",")
    frames = {tuple(line.split(",")[columns.index(name)] for name in ("case", "frames")) for line in table[1:]}
    assert frames == {("near", "2"), ("oblique", "2"), ("mid", "4"), ("far", "6"), ("short", "2")}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--suite", "paper", "--keep", "x"), "--keep: writes the takes of --suite wild, and of no other"),
        (
            ("--suite", "wild", "--method", "likelihood"),
            "--method likelihood: is not for the suite wild, which has ledpi, oracle, ",
        ),
        (("--suite", "paper", "--method", "oracle"), "--method oracle: is not for the suite paper"),
        (("--suite", "wild", "--case", "windy"), "--case windy: wild has only: near, oblique, mid, far, short"),
        (("--suite", "wild", "--take", "1", "--case", "near"), "--take: --suite wild writes its takes with --keep DIR"),
        (("--suite", "wild", "--distance", "2"), "--distance: the suite wild draws its own"),
        (("--suite", "wild", "--exposure-us", "2000"), "--exposure-us: the suite wild draws its own"),
    ],
)
def test_what_wild_cannot_do_is_said_in_one_line(arguments: tuple[str, ...], message: str, tmp_path: Path) -> None:
    """And nothing is written."""
    with pytest.raises(LedpiError) as refused:
        run("--out", str(tmp_path / "out"), *arguments)
    assert isinstance(refused.value, ConfigError)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "out" / "units.jsonl").exists()
