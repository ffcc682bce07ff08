"""The budget of a frame: the worst pictures stay within it, and what it cannot look at has its turn."""

from __future__ import annotations

import dataclasses
import itertools
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest

from ledpi.camera.simulated import open_simulated
from ledpi.config.settings import load_config
from ledpi.core.records import Decoded, Floats, Frame
from ledpi.daemon.daemon import Daemon
from ledpi.daemon.liveness import MAX_BUDGET, MIN_BUDGET, SHARE, Pacing
from ledpi.pipeline.likelihood import STREAM_BUDGET
from ledpi.pipeline.pipeline import Pipeline
from tests.builders.daemon import SIMULATED, controller
from tests.builders.decode import PINHOLE, Bits, Canvas, camera_info, panel_settings, square, word

RATE_HZ = 30
CANDIDATE = 80_000  # places that one takes which is fitted, and compared, as long as it may be
FOLLOWED, NEW = (square(200.3, 150.6, 90, 4), word(7)), (square(450.3, 310.6, 50, -5), word(23))
COMES = 4  # frames after which NEW is in view


def crowded(*panels: tuple[Floats, Bits], seq: int) -> Frame:
    """Panels, with room around them, among 128 white squares."""
    canvas = Canvas()
    for row, column in np.ndindex(8, 16):
        canvas.light[60 * row + 12 : 60 * row + 48, 40 * column + 8 : 40 * column + 32] = 0.4
    for corners, cells in panels:
        around = np.rint(1.25 * corners - 0.25 * corners.mean(axis=0)).astype(int)
        (left, top), (right, bottom) = around.min(axis=0), around.max(axis=0)
        canvas.light[top:bottom, left:right] = 0.03
        canvas.panel(corners, cells, start_us=1e6 * seq / RATE_HZ)
    return dataclasses.replace(canvas.frame(seq, seq=seq), row0_readout_ns=round(1e9 + 1e9 * seq / RATE_HZ))


def stream() -> Pipeline:
    return Pipeline(camera_info(), panel_settings(), intrinsics=PINHOLE, stream=True)


def ids(decoded: Decoded) -> set[int]:
    return {marker.detection.id for marker in decoded.markers}


def test_a_panel_s_second_frame_costs_less_than_half_of_its_first() -> None:
    """It is not located anew: its corners are refined."""
    path, costs = stream(), []
    for seq in range(2):
        canvas = Canvas()
        canvas.panel(*FOLLOWED, start_us=1e6 * seq / RATE_HZ)
        before = path.likelihood.spent
        path.decode(dataclasses.replace(canvas.frame(seq, seq=seq), row0_readout_ns=round(1e9 + 1e9 * seq / RATE_HZ)))
        costs.append(path.likelihood.spent - before)
    assert costs[1] < costs[0] / 2


@pytest.mark.parametrize("budget", [STREAM_BUDGET, MIN_BUDGET])
def test_a_panel_is_followed_beside_128_squares(budget: int) -> None:
    """It is read in every frame, and none spends a candidate more than it may."""
    path = stream()
    path.likelihood.search_budget = budget
    for seq in range(10):
        before = path.likelihood.spent
        assert ids(path.decode(crowded(FOLLOWED, seq=seq))) == {7}
        assert path.likelihood.spent - before <= budget + CANDIDATE


def test_a_panel_that_was_hidden_among_128_squares_is_read_in_the_frame_that_shows_it() -> None:
    """It is looked for first where it should be, whatever else there is to look at."""
    path = stream()
    path.likelihood.search_budget = MIN_BUDGET
    shown = [True] * 6 + [False] * 2 + [True]
    read = [ids(path.decode(crowded(*[FOLLOWED] * is_shown, seq=seq))) for seq, is_shown in enumerate(shown)]
    assert read == [{7} if is_shown else set() for is_shown in shown]


@pytest.mark.slow
def test_a_panel_that_comes_among_128_squares_is_read_within_a_second() -> None:
    """By the budget that a stream begins with, while another panel is followed."""
    path = stream()
    for seq in range(COMES):
        path.decode(crowded(FOLLOWED, seq=seq))
    later = (ids(path.decode(crowded(FOLLOWED, NEW, seq=seq))) for seq in range(COMES, COMES + RATE_HZ))
    assert any(seen == {7, 23} for seen in later)


IDS = (0, 7, 12, 42)
TOO_SMALL = 30_000  # for two that are followed
WAITS = "track.no_time"


def in_a_room(seq: int, *newcomer: tuple[Floats, Bits]) -> Frame:
    """Four panels in two rows, and the middle left free."""
    canvas = Canvas()
    for corners, cells in newcomer:
        canvas.panel(corners, cells, start_us=1e6 * seq / RATE_HZ)
    for number, marker_id in enumerate(IDS):
        corners = square(150.3 + 340 * (number % 2), 120.6 + 240 * (number // 2), 70, 4)
        canvas.panel(corners, word(marker_id), start_us=1e6 * seq / RATE_HZ)
    return dataclasses.replace(canvas.frame(seq, seq=seq), row0_readout_ns=round(1e9 + 1e9 * seq / RATE_HZ))


def followed_by(path: Pipeline) -> Pipeline:
    """The same, once it follows all."""
    for seq in range(8):
        last = path.decode(in_a_room(seq))
    assert ids(last) == set(IDS)
    return path


@pytest.mark.slow
def test_followed_panels_share_a_budget_that_is_too_small_for_all() -> None:
    """No panel waits where it suffices; else none spends more than it may, and what has waited longest comes first."""
    path = followed_by(stream())
    assert WAITS not in {rejected.key for rejected in path.decode(in_a_room(8)).rejected}
    path.likelihood.search_budget = budget = TOO_SMALL
    shown: list[set[int]] = []
    for seq in range(9, 21):
        before = path.likelihood.spent
        decoded = path.decode(in_a_room(seq))
        assert path.likelihood.spent - before <= budget + CANDIDATE // 2
        shown.append(ids(decoded))
        assert len(shown[-1]) + [rejected.key for rejected in decoded.rejected].count(WAITS) == len(IDS)
    assert all(0 < len(seen) < len(IDS) for seen in shown)
    assert all(set().union(*shown[k : k + 6]) == set(IDS) for k in range(len(shown) - 5))


def test_a_panel_comes_into_a_room_whose_panels_take_all_there_is() -> None:
    """A part of the budget is a search's, where one is due."""
    path = followed_by(stream())
    path.likelihood.search_budget = TOO_SMALL
    newcomer = square(320.3, 240.6, 60, 4), word(23)
    assert any(23 in ids(path.decode(in_a_room(seq, newcomer))) for seq in range(8, 8 + RATE_HZ))


@pytest.mark.slow
def test_no_result_depends_on_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same frames and budget give the same, bit by bit, though an hour passes with every look at the clock."""
    frames = [crowded(FOLLOWED, NEW, seq=seq) for seq in range(6)]
    one, other = stream(), stream()
    first = [one.decode(frame) for frame in frames]
    hours = itertools.count(step=3600.0)
    for clock in ("perf_counter", "monotonic", "time"):
        monkeypatch.setattr(time, clock, lambda: next(hours))
    second = [other.decode(frame) for frame in frames]
    monkeypatch.undo()
    assert one.likelihood.spent == other.likelihood.spent
    assert [told(decoded) for decoded in first] == [told(decoded) for decoded in second]


def told(decoded: Decoded) -> object:
    """All of a frame's result but the times that it took."""
    markers = [(m.detection.id, m.detection.corners_px.tobytes(), m.detection.margin) for m in decoded.markers]
    return markers, [rejected.key for rejected in decoded.rejected]


# ---- The budget that follows from how long frames take


def after(pacing: Pacing, frames: int, *, spent: int, took_ms: float) -> list[int]:
    return [pacing.budget_after(spent, took_ms) for _ in range(frames)]


def test_a_budget_follows_from_how_long_frames_take() -> None:
    """On a processor that is throttled to a third it falls to a third, within seconds, and rises again after."""
    pacing = Pacing(period_ms=1e3 / RATE_HZ)
    fast = after(pacing, 100, spent=400_000, took_ms=30.0)
    slow = after(pacing, 100, spent=400_000, took_ms=90.0)
    again = after(pacing, 100, spent=400_000, took_ms=30.0)
    assert fast[-1] == pytest.approx(SHARE * 1e3 / RATE_HZ / 30.0 * 400_000, rel=0.01)
    assert slow == sorted(slow, reverse=True)
    assert slow[-1] == pytest.approx(fast[-1] / 3, rel=0.05)
    assert again == sorted(again)
    assert again[-1] == pytest.approx(fast[-1], rel=0.05)


@pytest.mark.parametrize(("took_ms", "budget"), [(1e9, MIN_BUDGET), (0.0, MAX_BUDGET)])
def test_a_budget_has_limits(took_ms: float, budget: int) -> None:
    """However long frames take, or short."""
    assert after(Pacing(period_ms=1e3 / RATE_HZ), 200, spent=100_000, took_ms=took_ms)[-1] == budget


def test_a_frame_that_had_nothing_to_look_at_says_nothing() -> None:
    """Nor much one that had little: its time is that of finding, and of the pose."""
    pacing = Pacing(period_ms=1e3 / RATE_HZ)
    before = after(pacing, 1, spent=100_000, took_ms=30.0)
    assert after(pacing, 100, spent=0, took_ms=20.0)[-1:] == before
    assert after(pacing, 3, spent=100, took_ms=20.0)[-1] > 0.6 * before[0]


@pytest.mark.slow
@pytest.mark.parametrize("lossless", [False, True])
def test_a_daemon_whose_frames_take_long_searches_less(lossless: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each frame says that it took a minute. Where capture waits for the decoder, there is no hurry."""
    decode, budgets = Pipeline.decode, []

    def slow(pipeline: Pipeline, frame: Frame, trace: None, *, on_partial: Callable[[Decoded], None]) -> Decoded:
        budgets.append(pipeline.likelihood.search_budget)
        return dataclasses.replace(decode(pipeline, frame, trace, on_partial=on_partial), stage_ms={"find": 60_000.0})

    monkeypatch.setattr(Pipeline, "decode", slow)
    with controller() as line:
        config = load_config(None, (*SIMULATED, f"serial.port={line.port}"))
        daemon = Daemon(config, open_simulated(config, paced=True), lossless=lossless)
        threading.Timer(1.5, daemon.stop).start()
        daemon.run()
        line.close()
    assert len(budgets) > 2
    assert budgets[0] == STREAM_BUDGET
    assert budgets[-1] == (STREAM_BUDGET if lossless else MIN_BUDGET)
