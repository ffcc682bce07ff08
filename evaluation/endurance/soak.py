"""Many frames through the whole daemon, unpaced: does it lose speed, memory, threads or files on the way?

Renders ten seconds of a robot that drives up to two panels and back, and runs `ledpi run --unpaced --frames N` on that
recording, again and again, with a pty for the controller, whose stream is read and checked. Looks at the process in
/proc. The first tenth of the frames (but at least 100) is warm-up: by then all that is kept has been made. Of the rest,
the memory of the first quarter is compared with that of the last one. Exit status 1 where it has grown by more than
--allow-mib, where threads or descriptors have, where a packet was damaged or an ID wrong, or where the daemon failed.

    python -m evaluation.endurance.soak [--frames 50000] [--width 640] [--allow-mib 1]
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

from evaluation import ROOT, end
from evaluation.endurance.process import MIB, Sample, growth_mib, sample
from ledpi.camera.simulate.scenes import DRIVE_IDS
from ledpi.wire import MarkerMessage, Message, State, StatusMessage
from tests.builders.daemon import Controller

SAMPLE_S = 0.02  # a short run of 300 frames takes two seconds, less than one of them after its warm-up
WARM_UP_SHARE, WARM_UP_FRAMES = 0.1, 100
ROUND_FRAMES = 600  # of the recording at most: the robot is back where it began
ROUNDS = 3  # at least: what the first one has seen, and made, is what the others need
ROWS = 20  # of the table that is printed on the way


class Line(Controller):
    """The other end of the line, which counts what it hears and keeps the last status: many packets come."""

    def __init__(self) -> None:
        self.ids: Counter[int] = Counter()
        self.last_status: StatusMessage | None = None
        super().__init__()

    def hear(self, message: Message) -> None:
        if isinstance(message, MarkerMessage):
            self.ids[message.id] += 1
        elif isinstance(message, StatusMessage):
            self.last_status = message


def ledpi(command: str, *options: str, settings: tuple[str, ...]) -> list[str]:
    """The command line that runs it, with the settings of a panel of 16 cm and these."""
    # The ring of the last seconds is full before the warm-up ends: what grows afterwards is lost.
    fixed = ("panels.side_m=0.16", "rewind.seconds=0.5")
    sets = [part for setting in (*fixed, *settings) for part in ("--set", setting)]
    return [sys.executable, "-c", "from ledpi.cli import main; main()", command, *options, *sets]


def render(take: Path, frames: int, width: int) -> None:
    """A recording of the drive, 4:3."""
    size = (f"camera.width={width}", f"camera.height={width * 3 // 4}")
    subprocess.run(
        ledpi("simulate", str(take), "--scene", "drive", "--frames", str(frames), settings=size), cwd=ROOT, check=True
    )


def run(frames: int, take: Path, controller: Line) -> tuple[int, str, list[tuple[int, Sample]]]:
    """Exit status, the log, and the samples of one daemon, each with the frames through it by then."""
    settings = (f"camera.source=recording:{take}", f"serial.port={controller.port}")
    command = ledpi("run", "--unpaced", "--frames", str(frames), settings=settings)
    samples: list[tuple[int, Sample]] = []
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
        log: list[str] = []
        assert process.stderr is not None
        reader = threading.Thread(target=lambda stream: log.extend(stream), args=(process.stderr,), daemon=True)
        reader.start()
        started, rows = time.monotonic(), 0
        while process.poll() is None:
            time.sleep(SAMPLE_S)
            status = controller.last_status
            if status is None or not status.frames or status.state is State.STOPPING:
                continue
            now = sample(process.pid)
            if now is None:
                continue
            samples.append((status.frames, now))
            if status.frames >= (rows + 1) * frames / ROWS:
                rows = status.frames * ROWS // frames
                since_s = time.monotonic() - started
                print(
                    f"{since_s:8.1f} s  {status.frames:7} frames  {now.own / MIB:7.2f} MiB  "
                    f"{now.threads} threads  {now.descriptors} descriptors  decoding "
                    f"{(status.decode_p50_us or 0) / 1e3:.1f} ms, p99 {(status.decode_p99_us or 0) / 1e3:.1f} ms",
                    flush=True,
                )
        reader.join()
    return process.returncode, "".join(log), samples


def judge(frames: int, width: int, allow_mib: float) -> dict[str, bool]:
    """Runs it, prints what came of it, and returns which faults hold."""
    controller = Line()
    with tempfile.TemporaryDirectory() as folder:
        take = Path(folder) / "drive"
        render(take, min(frames // ROUNDS, ROUND_FRAMES), width)
        started = time.monotonic()
        status, log, samples = run(frames, take, controller)
        seconds = time.monotonic() - started
    controller.close()
    ended = re.search(r"ended: (\d+) frames, (\d+) dropped, (\d+) decoded, (\d+) markers", log)
    if status != 0 or ended is None:
        return {f"the daemon ended with status {status}:\n{log}": True}
    delivered, dropped, decoded, markers = map(int, ended.groups())
    warm = [one for reached, one in samples if reached >= max(WARM_UP_FRAMES, WARM_UP_SHARE * frames)]
    print(
        f"{delivered} frames in {seconds:.1f} s ({delivered / seconds:.1f} frames/s, start-up included), {dropped} "
        f"dropped, {decoded} decoded, {markers} markers; packets {controller.receiver.counters}; "
        f"IDs {dict(sorted(controller.ids.items()))}"
    )
    if len(warm) < 8:
        return {f"too short to judge: {len(warm)} samples after the warm-up": True}
    growth, first, last = growth_mib(warm), warm[0], warm[-1]
    wrong_ids = sorted(set(controller.ids) - set(DRIVE_IDS))
    return {
        f"memory has grown by {growth:.2f} MiB, more than {allow_mib:g}": growth > allow_mib,
        "threads have become more": last.threads > first.threads,
        "descriptors have become more": last.descriptors > first.descriptors,
        f"{delivered} frames came, {decoded} were decoded, of {frames}": not delivered == decoded == frames,
        "no panel was read": not controller.ids,
        f"IDs that are not in the scene: {wrong_ids}": bool(wrong_ids),
        f"damaged packets: {controller.receiver.counters.bad}": bool(controller.receiver.counters.bad),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--frames", type=int, default=50_000)
    parser.add_argument("--width", type=int, default=640, help="of the pictures, which are 4:3")
    parser.add_argument("--allow-mib", type=float, default=1.0, help="growth after the warm-up that is taken for none")
    arguments = parser.parse_args()
    end("soak", judge(arguments.frames, arguments.width, arguments.allow_mib))


if __name__ == "__main__":
    main()
