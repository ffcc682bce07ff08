"""Who does the work: processes on this machine, or a dask.distributed cluster. The results are the same."""

from __future__ import annotations

import multiprocessing
import os
import re
import signal
import threading
from collections.abc import Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from evaluation.suites.units import Unit, run_unit
from ledpi.core.errors import ConfigError, LedpiError
from ledpi.core.wording import install_command

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
