"""`ledpi bridge`: what the daemon sees, sent on."""

from __future__ import annotations

import signal
from pathlib import Path

import typer

from ledpi.cli import CONFIG, SET, app
from ledpi.config.settings import find_config, load_config
from ledpi.core.errors import ConfigError
from ledpi.daemon.reporting import log_to_standard_error
from ledpi.daemon.tap.places import AUTO, of_config
from ledpi.links.bridge import Bridge, open_target


@app.command()
def bridge(
    name: str = typer.Argument(metavar="NAME", help="One of `outputs` in the configuration."),
    config: Path | None = CONFIG,
    set_: list[str] = SET,
) -> None:
    """Send poses to MQTT, NetworkTables, ROS 2, MAVLink, UDP or TCP.

    It reads the running daemon's tap, and never slows the daemon down. Daemon and target may come and go at any time.
    A frame that cannot be sent at once is dropped and counted. Ends with Ctrl-C or SIGTERM.

    Exit status 2: a person has to act (a wrong password, an expired certificate, a missing package).

    Example: ledpi bridge field --set 'outputs={field: {kind: udp, host: 10.0.0.2, port: 5000}}'
    """
    log_to_standard_error()
    settings = load_config(find_config(config), tuple(set_), without_file=("panels.side_m=1",))
    socket_path = of_config(settings)
    if socket_path is None:
        raise ConfigError("tap.socket: is null, so the daemon tells nothing; must be auto, or the daemon's path")
    if name not in settings.outputs:
        known = ", ".join(settings.outputs) or "none"
        raise ConfigError(f"outputs.{name}: is not in the configuration; it has: {known}")
    target = open_target(name, settings.outputs[name])
    only_of = settings.file if settings.tap.socket == AUTO else None  # else it was chosen
    max_age_ms = settings.outputs[name].max_age_ms or settings.serial.max_age_ms
    running = Bridge(name, target, socket_path, max_age_ms, only_of)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: running.stop())
    running.run()
