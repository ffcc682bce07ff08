"""However `ledpi run` ends: with one line and its exit status, also where a thread works on or none is left."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.builders.daemon import COMMAND, SIMULATED, Controller, Ended, controller, daemon, end, write_recording

# A frame that takes as long as a robot's processor may need for the worst one, from frame 31 on.
SLOW_FRAME = """
import time, cv2, numpy as np
from ledpi.pipeline.pipeline import Pipeline
decode, picture = Pipeline.decode, np.zeros((1500, 1500), np.uint8)
def slowly(*arguments, **options):
    decoded, until_s = decode(*arguments, **options), time.monotonic() + 3.0 * (arguments[1].seq > 30)
    while time.monotonic() < until_s:
        cv2.GaussianBlur(picture, (0, 0), 3)
    return decoded
Pipeline.decode = slowly
"""
# The main thread fails in the fourth second.
FAILS = """
from ledpi.daemon import daemon
seconds = []
def second_line(*arguments):
    seconds.append(1)
    if len(seconds) > 3:
        raise {error}
    return "fine"
daemon.second_line = second_line
"""
# Once all is loaded, the system gives 3 MB more: to no thread, which takes 8.
NO_THREAD = """
import re, resource
import ledpi.pipeline.pipeline, ledpi.daemon.service
from ledpi.daemon import daemon
run = daemon.Daemon.run
def scant(self, *arguments):
    data = int(re.search(r"VmData:\\s+(\\d+)", open("/proc/self/status").read())[1]) * 1024
    resource.setrlimit(resource.RLIMIT_DATA, (data + 3_000_000, -1))
    return run(self, *arguments)
daemon.Daemon.run = scant
"""


def ended(tmp_path: Path, before: str) -> Ended:
    """Returns what comes of a daemon in front of which this runs."""
    write_recording(tmp_path / "take", 40)
    command = [*COMMAND[:2], before + COMMAND[2], *COMMAND[3:]]
    with (
        controller() as line,
        daemon(
            f"camera.source=recording:{tmp_path / 'take'}",
            f"serial.port={line.port}",
            "rewind.seconds=0",
            options=("--frames", "1000000"),
            command=command,
        ) as process,
    ):
        return end(process)


@pytest.mark.slow
def test_a_fault_while_a_frame_takes_long_is_one_line(tmp_path: Path) -> None:
    """Status 1; nobody waits for the frame, and C++ does not abort the process because of the thread that is in it."""
    done = ended(tmp_path, SLOW_FRAME + FAILS.format(error='OSError(5, "Input/output error")'))
    assert done.status == 1
    assert done.log[-1] == "ledpi: [Errno 5] Input/output error"
    assert not any("Traceback" in line for line in done.log)


@pytest.mark.slow
def test_a_mistake_of_ours_while_a_frame_takes_long_is_told_whole(tmp_path: Path) -> None:
    """Status 1 and its traceback, which only whoever mends it needs."""
    done = ended(tmp_path, SLOW_FRAME + FAILS.format(error='KeyError("of ours")'))
    assert done.status == 1
    assert done.log[-1] == "KeyError: 'of ours'"


@pytest.mark.slow
def test_where_no_thread_is_left_it_is_one_line(tmp_path: Path) -> None:
    """Status 1, so that another is started; with what would help."""
    done = ended(tmp_path, NO_THREAD)
    assert done.status == 1
    said = "the system gives this process no further thread; end others, or raise TasksMax= of the unit or ulimit -u"
    assert done.log[-1] == f"ledpi: {said}"
    assert not any("Traceback" in line for line in done.log)


# The camera's driver gives the same picture again and again, once a file is there.
FROZEN = """
from pathlib import Path
from ledpi.camera.simulated import SimulatedCamera
read, kept = SimulatedCamera.read, []
def frozen(self, into):
    frame = read(self, into)
    if frame is None:
        return None
    if kept and Path({hangs!r}).exists():
        into[:] = kept[0]
    else:
        kept[:] = [into.copy()]
    return frame
SimulatedCamera.read = frozen
"""


def after(line: Controller, frames: int) -> Callable[[Controller], bool]:
    """Tells whether so many frames more were taken than the last status has counted."""
    then = line.statuses[-1][1].frames + frames
    return lambda line: line.statuses[-1][1].frames > then


@pytest.mark.slow
@pytest.mark.parametrize("frozen", [False, True])
def test_a_picture_that_comes_again_is_no_news(frozen: bool, tmp_path: Path) -> None:
    """A camera that hangs and says otherwise: no pose is sent of what it showed before, and the journal counts why."""
    command = [*COMMAND[:2], FROZEN.format(hangs=str(tmp_path / "hangs")) + COMMAND[2], *COMMAND[3:]]
    with controller() as line, daemon(*SIMULATED, f"serial.port={line.port}", command=command) as process:
        line.wait_for(lambda line: len(line.markers) > 10 and bool(line.statuses))
        if frozen:
            (tmp_path / "hangs").touch()
        line.wait_for(after(line, 30))
        seen = len(line.markers)
        line.wait_for(after(line, 50) if frozen else lambda line: len(line.markers) > seen)
        done = end(process, signal.SIGTERM)
        assert (len(line.markers) == seen) == frozen
    assert ("capture.repeated" in done.log[-1]) == frozen
