"""A unit of work: some takes of one condition, read by each method. A pure function of its values, but for the times.

It is what is handed to a process of this machine, or of a dask.distributed cluster, and what is kept when a run is
broken off. The results are the same wherever it is done.
"""

from __future__ import annotations

import multiprocessing
import os
import re
import signal
import threading
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2

from evaluation.suites.conditions import PRINTED, Condition, Method
from evaluation.suites.draw import Take, draw_take
from evaluation.suites.readers import (
    WHITEST_PAPER,
    Family,
    apriltag_reader,
    aruco_reader,
    oracle_reads,
    printed_id,
    printed_scene,
)
from evaluation.suites.wild import draw_wild
from evaluation.suites.wild_rows import WILD
from ledpi.camera.simulate.render import Renderer, scene_truth
from ledpi.camera.simulate.scene import Scene
from ledpi.camera.simulate.sensor import sensor_info
from ledpi.config.panels import PanelSettings
from ledpi.core.errors import ConfigError, LedpiError
from ledpi.core.records import Frame
from ledpi.core.shutter import RowClock
from ledpi.core.wording import install_command
from ledpi.workshop.evaluate import page
from ledpi.workshop.evaluate.scoring import (
    FRAMES_A_TAKE,
    PANEL_METHODS,
    STREAM_ROWS,
    Expected,
    PanelReader,
    Read,
    Row,
    Tally,
)

TAKES_A_UNIT = 25  # a few seconds of work


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """All that a worker needs."""

    seed: int
    condition: Condition
    first_take: int
    takes: int
    methods: tuple[Method, ...]
    panels: PanelSettings
    frame_duration_us: float | None = None  # None: as the daemon would choose it
    code: str  # as `code_version` of whoever asks

    @property
    def key(self) -> str:
        """One of a kind within a run."""
        return f"{self.condition.name} #{self.first_take}"

    def rows_of(self, method: Method) -> tuple[Row, ...]:
        """The rows that a method fills. Of decoys all frames count, and none is special."""
        if method != "stream":
            return (method,)
        return tuple(STREAM_ROWS) if self.condition.suite != "decoys" else ("stream_all",)


def code_version() -> str:
    """Returns what the results depend on, besides a unit's values: the sources of ledpi and of this package."""
    return page.code_version(Path(__file__).parent)


def run_unit(unit: Unit) -> dict[str, Any]:
    """{"unit": key, "rows": {row: Tally as JSON}}. Raises ConfigError on a worker that runs other code."""
    if unit.code != code_version():
        raise ConfigError(f"a worker runs other code: {code_version()}; must be {unit.code}, as here")
    cv2.setNumThreads(1)  # units share the cores among them
    rows: dict[Row, Tally] = {row: Tally() for method in unit.methods for row in unit.rows_of(method)}
    for number in range(unit.first_take, unit.first_take + unit.takes):
        if unit.condition.suite == "wild":
            _read_wild(number, unit, rows)
            continue
        take = draw_take(unit.condition, unit.panels, unit.seed, number, unit.frame_duration_us)
        for tally in rows.values():
            tally.trials += max(1, len(take.scene.panels) if unit.condition.suite != "decoys" else 1)
        _read_panels(take, number, unit, rows)
        for family in PRINTED:
            if family in unit.methods:
                (read,) = _read_prints(take, unit, family, take.peak_level)
                truths = [Expected.from_truth(truth) for truth in scene_truth(take.scene, 0)]
                expected = [replace(e, id=printed_id(family, unit.panels.dictionary, e.id)) for e in truths]
                rows[family].add(read, expected, f"take {number}, frame 0")
    return {"unit": unit.key, "rows": {row: tally.as_json() for row, tally in rows.items()}}


def _read_panels(take: Take, number: int, unit: Unit, rows: dict[Row, Tally]) -> None:
    """Methods that keep nothing read one frame of a take: the others show the same. Of decoys they read all."""
    sensor, panels = take.scene.sensor, unit.panels
    info = sensor_info(sensor, take.reported_row_time)
    clock = RowClock(info)  # of a camera that has run for a while: what its frames' times tell is known
    for seq in range(FRAMES_A_TAKE):
        clock.add(seq, sensor.row0_readout_ns(seq))
    readers = {m: PanelReader(m, clock.corrected(info), panels) for m in PANEL_METHODS if m in unit.methods}
    alone = 1 if unit.condition.suite != "decoys" else FRAMES_A_TAKE
    for index, frame in enumerate(photographed(take, take.scene, FRAMES_A_TAKE if "stream" in readers else alone)):
        expected = [Expected.from_truth(truth) for truth in scene_truth(take.scene, frame.seq)]
        for method, reader in readers.items():
            if method == "stream" or index < alone:
                read = reader.read(clock.corrected(frame))
                for row in unit.rows_of(method):
                    if index in STREAM_ROWS.get(row, range(FRAMES_A_TAKE)):
                        rows[row].add(read, expected, f"take {number}, frame {frame.seq}")


def _read_prints(take: Take, unit: Unit, family: Family, paper_level: float, frames: int = 1) -> list[Read]:
    """The first frames, with prints in the panels' place."""
    dictionary, lens, side_m = unit.panels.dictionary, take.scene.sensor.intrinsics, unit.panels.side_m
    reader = aruco_reader(dictionary, side_m, lens) if family == "aruco" else apriltag_reader(side_m, lens)
    scene = printed_scene(take.scene, family, dictionary, paper_level)
    return [reader.read(frame) for frame in photographed(take, scene, frames)]


def _read_wild(number: int, unit: Unit, rows: dict[Row, Tally]) -> None:
    """The frames of a take that its row judges: by ledpi, with the true corners given, and of a print."""
    asked, take = WILD[unit.condition.case], draw_wild(unit.condition.case, unit.panels, unit.seed, number)
    sensor, (panel,) = take.scene.sensor, take.scene.panels
    frames = list(photographed(take, take.scene, asked.judged.stop))
    truths = [scene_truth(take.scene, frame.seq) for frame in frames]
    reads: dict[Row, list[Read]] = {}
    if "ledpi" in unit.methods:
        reader = PanelReader("likelihood" if asked.is_single else "stream", sensor_info(sensor), unit.panels)
        reads["ledpi"] = [reader.read(frame) for frame in frames]
    if "oracle" in unit.methods:
        views = [(frame, truth.corners_px) for frame, (truth,) in zip(frames, truths, strict=True)]
        spec = unit.panels.spec(panel.marker_id)
        reads["oracle"] = oracle_reads(views, sensor.intrinsics, unit.panels.dictionary, spec)
    if "aruco" in unit.methods:
        reads["aruco"] = _read_prints(take, unit, "aruco", min(take.peak_level, WHITEST_PAPER), len(frames))
    for row, tally in rows.items():
        tally.trials += 1
        for seq in asked.judged:
            tally.add(reads[row][seq], [Expected.from_truth(t) for t in truths[seq]], f"take {number}, frame {seq}")


def photographed(take: Take, scene: Scene, frames: int) -> Iterator[Frame]:
    """The first frames of a take, with what the driver says of them."""
    renderer = Renderer(scene, seed=take.seed)
    for seq in range(frames):
        yield renderer.frame(seq, reported_row_time=take.reported_row_time)


CONNECT_S = 10


def run_on_processes(units: Sequence[Unit], workers: int) -> Generator[dict[str, Any], None, None]:
    """Records as their units finish, in whatever order. Raises ConfigError where a worker dies."""
    if not units:
        return
    # One thread a worker: the cores are shared out by units. Read when a worker loads numpy.
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    # Not by fork: OpenCV's threads do not survive it.
    context = multiprocessing.get_context("spawn")
    others = multiprocessing.active_children()
    with ProcessPoolExecutor(min(workers, len(units)), mp_context=context, initializer=_end_with_parent) as pool:
        futures = [pool.submit(run_unit, unit) for unit in units]
        try:
            for future in as_completed(futures):
                yield future.result()
        except BrokenProcessPool:
            raise ConfigError("a worker process has died; the same command resumes the work") from None
        except BaseException:  # Ctrl-C: what is half done will not be asked for, and may take long
            for worker in multiprocessing.active_children():
                if worker not in others:
                    worker.terminate()
            raise
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _end_with_parent() -> None:
    """Ties a worker to the process that hands out the work: it ends where that one is no more.

    The terminal sends Ctrl-C to every process, so that is not for workers to heed.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def run_on_cluster(units: Sequence[Unit], address: str) -> Generator[dict[str, Any], None, None]:
    """As `run_on_processes`, on the workers of the scheduler at `address`, as in tcp://host:8786.

    They must have this very code. Raises ConfigError where they have not, where dask.distributed is not installed,
    and where there is no scheduler.
    """
    try:
        from distributed import Client
        from distributed import as_completed as as_completed_there
    except ImportError:
        raise ConfigError(f"--scheduler: needs dask.distributed: {install_command('suites')}") from None
    if not re.fullmatch(r"(\w+://)?.+:\d+", address):
        raise ConfigError(f"--scheduler {address}: must be as tcp://HOST:PORT")
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except OSError as error:
        raise ConfigError(f"--scheduler {address}: no scheduler answers there: {error}") from None
    with client:
        futures = client.map(run_unit, units, pure=False)
        try:
            for future in as_completed_there(futures, loop=client.loop):
                yield future.result()
        except LedpiError:
            raise
        except Exception as error:  # whatever a worker that lacks something raises
            raise ConfigError(f"--scheduler {address}: a worker failed: {type(error).__name__}: {error}") from error
        finally:
            client.cancel(futures)
