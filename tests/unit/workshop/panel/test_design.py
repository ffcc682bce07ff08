"""`ledpi panel design`: which pairs of frequencies tell a panel's classes apart, and why others do not."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from ledpi.camera.simulate.render import Renderer, scene_truth
from ledpi.camera.simulate.scene import OV5647_ROW_TIME_US, Panel, Room, Scene, SimulatedSensor
from ledpi.camera.simulate.scenes import ov5647_lens, whole_rows_us
from ledpi.camera.simulate.trajectory import Still, facing_camera
from ledpi.cli import app, main, panel_design
from ledpi.cli.panel_design import farthest_first
from ledpi.config.settings import load_config
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import ConfigError
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify import decision
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.codewords import rank_codewords
from ledpi.workshop.panel.design import (
    ENOUGH_NATS,
    Proposal,
    Task,
    antiphase_proposals,
    auto_rows,
    candidate_pairs,
    choose_period,
    proposal_at,
    views_of,
)
from ledpi.workshop.panel.design_text import findings
from ledpi.workshop.panel.frequencies import NULL_SHARE, Flicker, null_share, worthwhile_frequencies
from ledpi.workshop.panel.information import View, evidence_of, separation_nats, view_panel
from ledpi.workshop.panel.reach import Reach, chance_of_reading, reach_of
from tests.builders import ROOT
from tests.builders.samples import observed

assert panel_design, main  # the import puts the command into `app`
TRUE_10_MS_US = whole_rows_us(10_000.0, OV5647_ROW_TIME_US)
DICTIONARY = load_dictionary("DICT_4X4_50")
CURRENT_ROW_US = 1852 / 58.333333  # of the current driver: in 504 of them 1250 Hz advance by 20.0016 cycles
pytestmark = pytest.mark.usefixtures("elsewhere")


def sensor(exposure_us: float = TRUE_10_MS_US, rows: int = 504) -> SimulatedSensor:
    return SimulatedSensor(intrinsics=ov5647_lens(), exposure_us=exposure_us, frame_length_rows=rows)


def task(
    *distances_m: float,
    rows: int | None = None,
    tolerance: float = 1e-4,
    flicker: Flicker = Flicker.LOW_RISK,
    exposure_us: float = TRUE_10_MS_US,
) -> Task:
    """A panel of 16 cm before an OV5647."""
    return Task(
        sensor=sensor(exposure_us, rows or 504),
        period_given=rows is not None,
        side_m=0.16,
        cells=4,
        duty=0.5,
        distances_m=distances_m,
        tolerance=tolerance,
        flicker=flicker,
    )


CURRENT = replace(sensor(), row_time_us=CURRENT_ROW_US, exposure_us=whole_rows_us(10_000.0, CURRENT_ROW_US))


def told(asked: Task, black_hz: float, white_hz: float, rows: int = 504) -> str:
    """All that makes a pair unusable, as one text."""
    return "\n".join(f.text for f in findings(asked, black_hz, white_hz, rows) if f.unusable)


def run(*arguments: str) -> tuple[int, str]:
    """Exit status and standard output; a LedpiError comes through, as `main` prints it."""
    result = CliRunner().invoke(app, ["panel", "design", *arguments])
    if isinstance(result.exception, ConfigError):
        raise result.exception
    return result.exit_code, result.stdout


@pytest.fixture(scope="module")
def near() -> View:
    """Pictures of a steady panel from 1.4 m."""
    return seen_from(1.4)


def seen_from(distance_m: float) -> View:
    view = view_panel(sensor(), 4, 0.16, distance_m)
    assert isinstance(view, View)
    return view


def nats(view: View, black_hz: float, white_hz: float, *, frames: int, rows: int = 504) -> float:
    asked = task(view.distance_m)
    known = evidence_of(view, asked.spec(black_hz, white_hz), frames=frames, frame_length_rows=rows)
    return separation_nats(known, asked.depths(black_hz, white_hz))


def even_evidence(each: float, depth: float) -> Evidence:
    """Every cell's information is `each` on every parameter, and cells share nothing."""
    information = np.zeros((16, 4, 16, 4))
    for cell in range(16):
        information[cell, :, cell, :] = each * np.eye(4)
    return Evidence(score=np.zeros((16, 4)), information=information, prior=np.full(4, depth**2 / 2))


def test_a_null_is_where_the_exposure_holds_whole_cycles() -> None:
    """By hand: 2·min(r, 1 − r) of the deepest bands near by are left, r the fractional part of f·T."""
    assert null_share(1250.0, 9967.0) == pytest.approx(1 - 2 * abs(12.459 - 12.5), abs=1e-3)
    assert null_share(2000.0, 9967.0) == pytest.approx(2 * abs(19.934 - 20), abs=1e-3)
    # 2450 Hz ± 2 % reaches 2401 Hz, where 9967 µs hold 23.93 cycles, and 2409 Hz, where they hold 24.
    assert null_share(2450.0, 9967.0, tolerance=0.0001) > NULL_SHARE
    assert null_share(2450.0, 9967.0, tolerance=0.02) == 0.0


def test_what_is_worth_trying_lies_between_the_nulls_and_can_be_made() -> None:
    """Each from the flicker limit on, deep in its lobe, and a whole number of the driver's clock cycles."""
    tried = worthwhile_frequencies(TRUE_10_MS_US, 1250.0)
    assert len(tried) == 14
    for hz in tried:
        assert hz >= 1250.0
        assert null_share(hz, TRUE_10_MS_US) > 0.97
        cycles = 16_000_000 / (2 * hz)
        assert cycles == pytest.approx(round(cycles), abs=0.02)
    without_nulls = worthwhile_frequencies(150.0, 1250.0)  # at 150 µs the first is at 6667 Hz: steps upward
    assert without_nulls[0] == 1250.0
    assert np.diff(np.log(without_nulls)) == pytest.approx(np.log(1.1), rel=1e-2)
    assert without_nulls[-1] > 4500.0
    assert len(worthwhile_frequencies(100_000.0, 1250.0)) <= 16  # at 0.1 s a null lies every 10 Hz


def test_information_foretells_likelihood_ratios(near: View) -> None:
    """In a rendered panel a cell taken for the other class costs, within a third, what a steady panel foretells."""
    asked = task(1.4)
    spec = asked.spec(1250.0, 2450.0)
    lens = replace(ov5647_lens(), distortion=(0.0, 0.0, 0.0, 0.0, 0.0))
    motion = Still(facing_camera(np.array([0, 0, 1.4]), roll_deg=2.0))
    panel = Panel(codeword=DICTIONARY.codeword(7), spec=spec, motion=motion, marker_id=7)
    scene = Scene(sensor=replace(asked.sensor, intrinsics=lens), panels=(panel,), room=Room(distance_m=2.0))
    renderer, corners = Renderer(scene, seed=5), scene_truth(scene, 0)[0].corners_px
    costs = []
    for seq in range(12):
        seen = replace(near, shots=(observed(renderer.frame(seq), corners, spec),))
        known = evidence_of(seen, spec, frames=1, frame_length_rows=504)
        costs.append(-np.mean(rank_codewords(known, DICTIONARY.codeword(7).reshape(1, 16).astype(np.float32)).gain))
    own = np.einsum("cicj->cij", evidence_of(near, spec, frames=1, frame_length_rows=504).information)
    square = np.repeat(np.square(asked.depths(1250.0, 2450.0)), 2) / 2
    foretold = 0.5 * float((np.einsum("cii->ci", own) * square).sum(axis=1).mean())  # over phases
    assert np.mean(costs) == pytest.approx(foretold, rel=1 / 3)


def test_enough_information_is_enough() -> None:
    """The decoder's own decision is right in 97 of 100 draws; with a tenth it is not; what is certain is not drawn."""
    depth, spec = 0.05, task().spec(1250.0, 2450.0)
    ids = set(range(50)) - set(DICTIONARY.part_like_ids())  # a part of a panel looks nearly like these
    codebook = Codebook.build(sorted(ids), DICTIONARY, spec)
    for share, least, most in ((3.0, 1.0, 1.0), (1.0, 0.965, 1.0), (0.1, 0.0, 0.1), (0.05, 0.0, 0.0)):
        known = even_evidence(share * ENOUGH_NATS / depth**2, depth)
        assert least <= chance_of_reading(known, codebook, (depth, depth), decision.FALSE_ID_RATE, draws=200) <= most


def test_frequencies_that_nearly_coincide_or_freeze_tell_less(near: View) -> None:
    """A hundred hertz apart in one frame; in several, 522 rows in which neither phase moves, beside 504."""
    assert nats(near, 1253.33, 1353.64, frames=1) < 0.5 * nats(near, 1253.33, 2457.76, frames=1)
    far = seen_from(8.0)
    assert nats(far, 1250.0, 2450.0, frames=4, rows=522) < nats(far, 1250.0, 2450.0, frames=4, rows=504) / 5


def test_a_proposal_always_moves() -> None:
    """Also where one frame tells enough, at 135 µs: the shortest period that does, and auto's is hardly longer."""
    asked = task(1.0, exposure_us=4 * OV5647_ROW_TIME_US)
    views = views_of(asked)
    for pair in ((1250.0, 2313.48), (1457.99, 2313.48)):
        proposal = choose_period(asked, *pair, views)
        assert asked.least_advance(*pair, proposal.frame_length_rows) >= 1 / 6
        assert auto_rows(asked, pair) / 1.1 <= proposal.frame_length_rows <= auto_rows(asked, pair)


def test_more_than_enough_counts_as_enough() -> None:
    """Near by every pair is read; what it tells beyond does not outweigh what another tells far away."""
    near_by = Proposal(black_hz=1, white_hz=2, frame_length_rows=504, alone=(9000.0, 5.0), stream=(9000.0, 10.0))
    far_away = replace(near_by, alone=(900.0, 6.0), stream=(900.0, 12.0))
    assert far_away.dominates(near_by)
    assert not near_by.dominates(far_away)


@pytest.mark.parametrize(
    ("asked", "pair", "says"),
    [
        (task(), (1250.0, 2450.0), r"\A\Z"),
        (task(), (1000.0, 2000.0), r"black, 1000 Hz: on a null.* 9\.97 of its cycles.*1253\.33 Hz"),
        (task(), (1000.0, 2000.0), r"white, 2000 Hz: on a null.* 19\.93 of its cycles.*1955\.99 Hz"),
        (task(), (650.0, 2450.0), "flickers"),
        (task(flicker=Flicker.NO_EFFECT), (1250.0, 3060.0), "flickers"),
        (task(), (1250.0, 1250.0), "coincide"),
        (task(), (1253.0, 1300.0), "must be 62 Hz apart"),  # 480 rows of 33.67 µs are 1/62 s
        (task(), (1253.0, 1353.64), r"\A(?![\s\S]*coincide)"),
        (task(exposure_us=20 * OV5647_ROW_TIME_US), (1250.0, 25e3), "the driver's timer cannot make it"),
        (task(exposure_us=20 * OV5647_ROW_TIME_US), (1250.0, 25e3), r"too fast: its bands are 0\.59 rows high"),
        (task(tolerance=0.05), (1250.0, 2450.0), "none near by is good"),
        (replace(task(), sensor=CURRENT), (1250.0, 2450.0), r"\A1250 Hz is frozen at 62\.495 fps: .* moves both\Z"),
    ],
)
def test_what_makes_a_pair_unusable(asked: Task, pair: tuple[float, float], says: str) -> None:
    """Nulls with what would be right near by, flicker, bands that coincide or freeze, and what no timer can make."""
    assert re.search(says, told(asked, *pair))


def test_a_cell_holds_fewer_periods_from_further_off() -> None:
    """By hand: from 2 m 4 cm are 12.86 px at 643 px focal length, rows of 33.67 µs of a wave of 1250 Hz."""
    assert task().periods_in_a_cell(1250.0, 2.0) == pytest.approx(0.541, abs=2e-3)
    assert task().periods_in_a_cell(2500.0, 4.0) == pytest.approx(0.541, abs=2e-3)


def test_drifting_oscillators_are_no_help_to_a_stream() -> None:
    """At 1 % a phase is lost from one frame to the next; at 100 ppm it is kept for a hundred."""
    assert task(tolerance=0.01).coherent_frames(2450.0, 504) == 1
    assert task(tolerance=1e-4).coherent_frames(2450.0, 504) > 50


def test_no_pair_for_such_oscillators() -> None:
    """± 5 % of 1250 Hz are more than a whole lobe at 10 ms; a shorter exposure is named, and has pairs."""
    with pytest.raises(ConfigError, match=r"± 50000 ppm.*at most 4800 µs"):
        candidate_pairs(task(tolerance=0.05))
    assert candidate_pairs(task(tolerance=0.05, exposure_us=4 * 33.67))


def test_what_cannot_be_seen_is_refused_with_the_nearest_and_the_farthest() -> None:
    """480 rows at 643 px focal length: 16 cm fill them at 0.21 m; a cell needs two pixels, even at 1000 km."""
    for distances_m, says in (
        ((0.1,), r"0.1: .* at least 0\.21"),
        ((1.0, 20.0), r"20: .*too_small.*at most 12\.6"),
        ((1.0, 1e6), r"1e\+06: .*too_small.*at most 12\.6"),
    ):
        with pytest.raises(ConfigError, match="--distance " + says):
            views_of(task(*distances_m))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--check", "1250", "2450", "--out", "design"), "--out design: is for a design; --check writes nothing"),
        (("--out", "file"), "--out file: cannot be written: File exists"),
        (
            ("--check", "1250", "2450", "--fps", "62.49", "--row-time-us", "33.67"),
            r"475 rows of 33\.67 µs; must be at least 504, at most 58\.93 fps",
        ),
    ],
)
def test_what_cannot_be_done_is_refused(arguments: tuple[str, ...], says: str) -> None:
    """Before anything is computed with it, which takes minutes."""
    Path("file").touch()
    with pytest.raises(ConfigError, match=says):
        run(*arguments)
    assert run("--distance", "inf")[0] == run("--distance", "nan")[0] == 2


@pytest.mark.slow
def test_check_begins_with_its_verdict_and_exits_with_1_if_that_is_bad(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a script would use it; faster frames than the usual row time allows have faster rows."""
    status, output = run("--check", "1000", "2000")
    assert (status, output.count("on a null")) == (1, 2)
    assert output.splitlines()[0] == "1000 and 2000 Hz cannot be used:"
    status, output = run("--check", "1250", "2450", "--fps", "62.49")
    assert status == 1
    assert "1250 Hz is frozen at 62.490 fps" in output
    monkeypatch.setattr("ledpi.workshop.panel.reach.DISTANCES", 3)
    good = ("--check", "1250", "2450", "--distance", "1", "--fps", "58.93")
    output = run(*good)[1]
    assert output.startswith("good are 1250.00 Hz (black cells) and 2450.00 Hz (white): a panel is read ")
    assert "note: IDs 3, 8 to 9, 17, 22, 30, 33, 37, 47 are reported only if panels.ids lists them: a part or" in output
    assert "panels.ids" not in run(*good, "--set", "panels.ids=[7]")[1]


@pytest.mark.slow
def test_antiphase_is_read_where_two_frequencies_are_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """One frame at 2.5 m, four frames at 8 m; with another duty one class would not fill the other's gaps."""
    monkeypatch.setattr("ledpi.workshop.panel.reach.DRAWS", 100)
    asked = task(2.5, 8.0)
    views = views_of(asked)
    one = antiphase_proposals(asked, views)[0]
    assert one is not None
    assert one.black_hz == one.white_hz
    two = proposal_at(asked, 1250.0, 2450.0, 504, views)
    antiphase, pair = (reach_of(asked, proposal, DICTIONARY, views) for proposal in (one, two))
    assert antiphase.alone[0] > 0.8 > 0.75 > pair.alone[0]
    assert antiphase.stream[1] > 0.6 > 0.4 > pair.stream[1]
    assert antiphase_proposals(replace(asked, duty=0.4), views) == []


@pytest.mark.slow
def test_an_antiphase_panel_is_checked_as_one() -> None:
    """One frequency for both classes is what it has; two are refused, and so are its null and its freezing, once."""
    one = ("--set", "panels.phase=antiphase", "--set", "panels.white_hz=1250")
    assert run("--check", "1250", "1250", *one, "--fps", "58.93")[0] == 0
    for pair, fps, says in (
        (("1250", "2450"), (), "both classes blink alike"),
        (("1000", "1000"), (), "on a null"),
        (("1250", "1250"), ("--fps", "62.49"), "is frozen"),
    ):
        status, output = run("--check", *pair, *one, *fps)
        assert (status, output.count(says)) == (1, 1)


@pytest.mark.slow
def test_a_design_is_a_configuration(monkeypatch: pytest.MonkeyPatch) -> None:
    """Five pairs and antiphase beside the present one, two plots, and lines that are loaded and found good."""
    monkeypatch.setattr("ledpi.workshop.panel.reach.DRAWS", 5)
    monkeypatch.setattr("ledpi.workshop.panel.reach.DISTANCES", 5)
    faint = ("--set", "panels.white_hz=2600")  # 25.9 cycles an exposure
    status, output = run("--distance", "1", "--distance", "8", "--fps", "58.93", "--out", "design", *faint)
    assert status == 0
    first = output.splitlines()[0]
    read = r"(?:a panel is read )?(?:to \S+ m|nowhere) in a single picture, "
    assert len(re.findall(r"\S+ Hz \(black cells\) and \S+ Hz \(white\): " + read, first)) == 2
    assert first.startswith("best are ")
    assert re.findall(r"^(\d|antiphase|present) ", output, re.MULTILINE) == [*"12345", "antiphase", "present"]
    assert re.search(r"^present: unusable: .*null", output, re.MULTILINE)
    config = load_config(Path("design/panel.yaml"))
    assert config.panels.side_m == 0.16
    assert config.camera.frame_duration_us == round(504.25 * OV5647_ROW_TIME_US)
    assert run("--check", str(config.panels.black_hz), str(config.panels.white_hz), "--fps", "58.93")[0] == 0
    antiphase = load_config(Path("design/antiphase.yaml")).panels
    assert (antiphase.phase, antiphase.white_hz) == ("antiphase", antiphase.black_hz)
    drawn = {"panel.yaml", "antiphase.yaml", "contrast.png", "reach.png"}
    assert {path.name for path in Path("design").iterdir()} == drawn


# ---- What is recommended


def reach(alone_m: float, stream_m: float) -> Reach:
    """Read for sure to there, and no further."""
    distances = (0.5, alone_m, alone_m + 0.001, stream_m, stream_m + 0.001)
    alone, stream = ([float(distance <= most) for distance in distances] for most in (alone_m, stream_m))
    return Reach(distances_m=distances, alone=tuple(alone), stream=tuple(stream))


def test_the_table_begins_with_what_is_read_furthest() -> None:
    """Alone times in a stream; pairs that are read less far than the present one in some respect come last."""
    proposals = [("pair", None, reach(*metres)) for metres in ((1.7, 7.1), (1.5, 8.4), (1.7, 8.0), (1.4, 9.9))]
    present: Any = ("present", None, reach(1.7, 6.9))
    ordered = farthest_first([*proposals, present], "pair", present)  # type: ignore[list-item]
    assert [round(row[2].carries_m2(), 1) for row in ordered] == [13.6, 12.1, 13.9, 12.6]


@pytest.mark.slow
def test_where_no_pair_is_read_further_yours_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """And the lines for config.yaml are of yours."""
    monkeypatch.setattr(panel_design, "reach_of", lambda *_: reach(1.7, 6.9))
    status, output = run("--distance", "1", "--fps", "58.93")
    assert status == 0
    assert output.startswith("keep yours, 1250.00 Hz (black cells) and 2450.00 Hz (white): ")
    assert "  black_hz: 1250.00\n  white_hz: 2450.00\n" in output


@pytest.mark.nightly  # a design with all of its draws
def test_the_pages_name_an_antiphase_frequency_that_is_read_as_far_as_the_best() -> None:
    """For the default camera and panel, of four pictures; those near the best differ by draws."""
    best_m = re.findall(r"^antiphase: .*?of 4 to (\S+) m", run()[1], re.MULTILINE | re.DOTALL)[0]
    for page in ("docs/first-panel.md", "docs/frequencies.md"):
        text = (ROOT / page).read_text(encoding="utf-8")
        (hz,) = set(re.findall(r"--phase antiphase --black ([\d.]+)", text))
        keys = ("phase=antiphase", f"black_hz={hz}", f"white_hz={hz}")
        said = run("--check", hz, hz, *(word for key in keys for word in ("--set", f"panels.{key}")))[1]
        assert float(re.findall(r"picture, to (\S+) m within 4", said)[0]) > 0.9 * float(best_m)
