"""`ledpi run`: the daemon."""

from __future__ import annotations

import logging
import os
import signal
import traceback
from pathlib import Path

import typer

from ledpi.cli import CONFIG, SET, app


@app.command()
def run(
    config: Path | None = CONFIG,
    set_: list[str] = SET,
    unpaced: bool = typer.Option(
        False, "--unpaced", help="Replay and simulator only: run as fast as frames are decoded."
    ),
    frames: int | None = typer.Option(
        None, "--frames", min=1, help="Replay and simulator only: stop after this many frames."
    ),
) -> None:
    """The daemon: camera to serial line, until Ctrl-C or SIGTERM.

    It decodes the camera's frames and streams IDs and poses to the serial port, which need not be there yet. It
    prints a status line on standard error every second, as a service every minute. SIGHUP reads the configuration
    again; if that is wrong, the old one stays in force. SIGUSR1 saves the last seconds as a recording.

    Exit status 0: ended by a signal, or at the end of a replay. 2: the configuration or a file is wrong. 1: the camera
    is absent, in use or lost, or something failed later; a service manager tries again.

    Example: ledpi run --set camera.source=simulated --set serial.port=/tmp/robot
    """
    asked = _keep_signals()
    import ledpi.wire.line  # noqa: F401, so that another package named serial is told of at once, with status 2
    from ledpi.camera.factory import open_camera
    from ledpi.config.settings import find_config, load_config
    from ledpi.core.errors import LedpiError, TransientError, one_line
    from ledpi.daemon.reporting import log_to_standard_error
    from ledpi.daemon.service import Service
    from ledpi.daemon.threads import NO_THREAD, end_threads, is_no_thread

    log_to_standard_error()
    file = find_config(config)
    try:
        service = Service(
            lambda: load_config(file, tuple(set_)),
            lambda settings: open_camera(settings, paced=not unpaced, frames=frames, recover=True),
            lossless=unpaced,
        )
    except RuntimeError as error:
        raise (TransientError(NO_THREAD) if is_no_thread(error) else error) from None
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: service.stop())
    signal.signal(signal.SIGHUP, lambda *_: service.reload())
    signal.signal(signal.SIGUSR1, lambda *_: service.save())
    if signal.SIGHUP in asked:
        service.reload()
    try:
        totals = service.run()
    except Exception as error:
        if not (isinstance(error, LedpiError | OSError) or is_no_thread(error)):
            end_threads(status=1, said=traceback.format_exc())
            raise
        # All was well when it started: what has come between may pass. If not, the next start says what to put right.
        failure = TransientError(NO_THREAD if is_no_thread(error) else str(error))
        end_threads(status=1, said=f"ledpi: {one_line(str(failure))}\n")
        raise failure from error
    logging.getLogger("ledpi").info(
        "ended: %d frames, %d dropped, %d decoded, %d markers, rejected: %s",
        totals.frames,
        totals.dropped,
        totals.decoded,
        totals.markers,
        ", ".join(f"{key} {count}" for key, count in totals.rejected.items()) or "nothing",
    )
    end_threads(status=0)


def _keep_signals() -> list[int]:
    """Until the daemon is there to hear of them: Ctrl-C ends the process, and no other signal does.

    By a handler that raises nothing: within an import, and there are many to come, an exception may be lost. systemd
    takes the end by a SIGHUP for a wish, and would not start another. Returns where the others are noted.
    """
    asked: list[int] = []
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, lambda *_: os._exit(130))
    for number in (signal.SIGHUP, signal.SIGUSR1):
        signal.signal(number, lambda number, _: asked.append(number))
    return asked
