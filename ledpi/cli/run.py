"""`ledpi run`: the daemon."""

from __future__ import annotations

import logging
import signal
import sys
from pathlib import Path

import typer

from ledpi.cli import app
from ledpi.errors import ConfigError


@app.command()
def run(
    config: Path | None = typer.Option(None, "--config", help="Default: ./config.yaml, /etc/ledpi/config.yaml."),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Overrides a key of the configuration."),
    unpaced: bool = typer.Option(False, "--unpaced", help="Replays and the simulator: as fast as they decode."),
    frames: int | None = typer.Option(None, "--frames", min=1, help="Replays and the simulator: end after so many."),
) -> None:
    """Decode the camera's frames and stream poses to the serial port, until Ctrl-C or SIGTERM.

    Each second one line on standard error says how it goes. Exit status 0 after a signal or at the end of a
    replay, 2 where the configuration, the camera or a file cannot be used, 1 where the camera is lost and does
    not come back, so that a service manager tries again.

    Example: ledpi run --set camera.source=simulated --set serial.port=/tmp/robot
    """
    from ledpi.camera.factory import open_camera
    from ledpi.config import find_config, load_config
    from ledpi.daemon import Daemon

    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="%(levelname)s %(message)s")
    file = find_config(config)
    if file is None and not set_:
        raise ConfigError("no configuration: --config FILE, ./config.yaml or /etc/ledpi/config.yaml")
    settings = load_config(file, tuple(set_))
    camera = open_camera(settings, paced=not unpaced, frames=frames, recover=True)
    daemon = Daemon(settings, camera, lossless=unpaced)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: daemon.stop())
    totals = daemon.run()
    health = totals.health
    logging.getLogger("ledpi").info(
        "ended: %d frames, %d dropped, %d decoded, %d markers, rejected: %s",
        totals.ring.published,
        totals.ring.dropped,
        health.decoded,
        health.markers,
        ", ".join(f"{key} {count}" for key, count in sorted(health.rejected.items())) or "nothing",
    )
