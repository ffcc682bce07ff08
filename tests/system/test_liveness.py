"""A lost camera and a decoder that is behind: told apart, and the controller hears the right one."""

from __future__ import annotations

import signal
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from ledpi.camera.recovering import LOST
from ledpi.camera.simulated import open_simulated
from ledpi.config.settings import load_config
from ledpi.core.records import Decoded, Frame, Pixels, Rejected
from ledpi.daemon.liveness import BEHIND_NS, LOST_BEHIND_TICKS, LOST_TICKS, Liveness
from ledpi.pipeline.pipeline import Pipeline
from ledpi.wire import NoFix, State, StatusMessage
from ledpi.wire.publisher import Publisher
from tests.builders.daemon import SIMULATED, OtherCamera, controller, daemon, daemon_in_thread, end

alone = pytest.mark.alone  # it tells how late a daemon is: no other test may take the processor meanwhile


def frame(age_ns: int) -> Frame:
    """Read out so long ago, by a camera whose clock runs 7 s behind."""
    camera, into = open_simulated(load_config(None, SIMULATED), paced=False), np.zeros((240, 320), np.uint8)
    taken = camera.read(into)
    assert isinstance(taken, Frame)
    row0_ns = time.monotonic_ns() - age_ns
    return replace(taken, row0_readout_ns=row0_ns - 7_000_000_000, host_offset_ns=7_000_000_000)


# ---- By itself


def test_a_camera_that_delivers_nothing_for_three_ticks_is_lost() -> None:
    """And the next frame is news."""
    liveness = Liveness()
    assert not liveness.delivers()
    for _ in range(LOST_TICKS):
        assert not liveness.lost
        liveness.tick()
    assert liveness.lost
    assert not liveness.behind
    assert liveness.delivers()
    assert not liveness.lost


def test_a_camera_that_says_so_is_lost_at_once() -> None:
    """It is news once."""
    liveness = Liveness()
    assert [liveness.loses(), liveness.loses()] == [True, False]
    assert liveness.lost


def test_a_decoder_is_behind_while_its_frame_is_old_and_after_one_that_was() -> None:
    """So that it does not look well each time that it takes a fresh frame; the first one in time ends that."""
    liveness = Liveness()
    liveness.begins(frame(2 * BEHIND_NS))
    assert liveness.behind
    liveness.ends()
    assert liveness.behind
    liveness.begins(frame(0))
    assert liveness.behind
    liveness.ends()
    assert not liveness.behind
    assert not liveness.lost


def test_a_slow_computer_has_lost_no_camera() -> None:
    """Its last frame was late, so the next one may be, too; silence of 3 s is the camera's."""
    liveness = Liveness()
    liveness.begins(frame(2 * BEHIND_NS))
    liveness.ends()
    for _ in range(LOST_BEHIND_TICKS):
        assert not liveness.lost
        liveness.tick()
    assert liveness.lost


# ---- In the daemon


class Pulled(OtherCamera):
    """The simulated camera, until it is pulled."""

    def __init__(self) -> None:
        super().__init__()
        self.pulled = threading.Event()

    def read(self, into: Pixels) -> Frame | Rejected | None:
        if self.pulled.is_set():
            time.sleep(0.01)
            return LOST
        return self._camera.read(into)


@pytest.mark.slow
@alone
def test_a_slow_decoder_is_behind_and_no_camera_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each frame takes 0.4 s: no pose is new enough to be sent, and the controller hears why."""
    decode = Pipeline.decode

    def slowly(pipeline: Pipeline, picture: Frame) -> Decoded:
        time.sleep(0.4)
        return decode(pipeline, picture)

    monkeypatch.setattr(Pipeline, "decode", lambda pipeline, picture, trace, on_partial: slowly(pipeline, picture))
    with controller() as line:
        config = load_config(None, (*SIMULATED, f"serial.port={line.port}"))
        with daemon_in_thread(config, open_simulated(config, paced=True)):
            line.wait_for(lambda end: sum(status.no_fix is NoFix.BEHIND for _, status in end.statuses) > 4)
        line.close()
    states = [status.state for _, status in line.statuses]
    reasons = [status.no_fix for _, status in line.statuses]
    assert set(states) == {State.STARTING, State.RUNNING, State.STOPPING}
    first = reasons.index(NoFix.BEHIND)
    assert set(reasons[first:-1]) == {NoFix.BEHIND}
    assert {status.panels_in_view for _, status in line.statuses[first:-1]} == {None}


@pytest.mark.slow
@alone
def test_a_process_that_was_held_up_has_lost_no_camera() -> None:
    """Stopped for half a second, twice: the clock has gone on, and the camera was there all the time."""
    with controller() as line, daemon(*SIMULATED, f"serial.port={line.port}") as process:
        line.wait_for(lambda end: bool(end.markers))
        for _ in range(2):
            process.send_signal(signal.SIGSTOP)
            time.sleep(0.5)
            process.send_signal(signal.SIGCONT)
            seen = len(line.markers)
            line.wait_for(lambda end, seen=seen: len(end.markers) > seen + 3)  # type: ignore[misc]
        assert end(process, signal.SIGTERM).status == 0
        line.close()
    assert State.CAMERA_LOST not in {status.state for _, status in line.statuses}


def test_a_loss_is_not_overtaken_by_what_was_seen_before_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The main thread is held up with a status in its hands; the camera is lost meanwhile, and that is said last."""
    camera, said, set_status = Pulled(), [], Publisher.set_status
    with controller() as line:
        config = load_config(None, (*SIMULATED, f"serial.port={line.port}"))

        def slowly(publisher: Publisher, status: StatusMessage) -> None:
            if status.state is State.RUNNING and not camera.pulled.is_set():
                camera.pulled.set()
                time.sleep(0.3)
            said.append(status.state)
            set_status(publisher, status)

        monkeypatch.setattr(Publisher, "set_status", slowly)
        with daemon_in_thread(config, camera):
            line.wait_for(lambda end: any(status.state is State.CAMERA_LOST for _, status in end.statuses))
    lost = said.index(State.CAMERA_LOST)
    assert State.RUNNING in said[:lost]
    assert State.RUNNING not in said[lost:]
