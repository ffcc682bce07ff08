"""`ledpi backup` and `ledpi restore`: configurations, and the files that they name, in one file."""

from __future__ import annotations

import os
import shlex
import stat
from pathlib import Path

import typer

from ledpi.cli import CONFIG, app
from ledpi.config.named_files import meant, passwords
from ledpi.config.settings import find_config, found_config
from ledpi.core.errors import ConfigError, one_line
from ledpi.core.files import read_bytes
from ledpi.workshop.backup import (
    MAX_BYTES,
    Backup,
    collect,
    enabled_units,
    is_service,
    left_out,
    pack,
    to_write,
    unpack,
)
from ledpi.workshop.calibrate.files import write_keeping_old


@app.command()
def backup(
    out: Path = typer.Argument(metavar="FILE", help="File to write. An older one is kept as FILE.bak-1."),
    config: Path | None = CONFIG,
) -> None:
    """Configuration, lens, map and udev rule → one file.

    Also a dictionary of your own and the outputs' certificates, and of the service's configuration those of other
    cameras, and which units are enabled. What is left out is said, as passwords are. `ledpi restore` puts everything
    back, on this computer or another. Only its owner can read the file, since it may hold the page's token.

    Example: ledpi backup robot.ledpi
    """
    source = found_config(config)
    files = collect(source)
    units = enabled_units() if is_service(source) else []
    kept = write_keeping_old(out, pack(files, units), mode=0o600)
    for file in files:
        typer.echo(f"{file.kind}: {file.path or source}")
    if units:
        typer.echo(f"enabled units: {', '.join(units)}")
    for line in left_out(source, files):
        typer.echo(line)
    typer.echo(f"{out}: written" + (f"; the older one is {kept}" if kept is not None else ""))


@app.command()
def restore(
    path: Path = typer.Argument(metavar="FILE", help="File that `ledpi backup` wrote."),
    config: Path | None = typer.Option(
        None, "--config", help="Configuration to write. Default: the one that is read here, else ./config.yaml."
    ),
) -> None:
    """Put back what `ledpi backup` saved.

    Files go where the configuration inside names them: in its folder, below it or in /var/lib/ledpi. A udev rule must
    be ledpi's own, with your values filled in. Everything is checked before anything is written, and each older file
    is kept as NAME.bak-1. Then it says which passwords are missing, and which units to enable.

    Example: ledpi restore robot.ledpi --config /etc/ledpi/config.yaml
    """
    saved, main = unpack(read_bytes(path, ConfigError, MAX_BYTES), path), find_config(config) or Path("config.yaml")
    changed = to_write(saved, main, path)
    typer.echo(f"{path}: made {saved.made} by ledpi {saved.made_by}")
    closed = [shlex.quote(str(to)) for to, file in changed if not file.mode & stat.S_IROTH and not to.exists()]
    for to, file in changed:
        kept = write_keeping_old(to, file.content, mode=file.mode)
        typer.echo(one_line(f"{file.kind}: {to}" + (f"; the older one is {kept}" if kept is not None else "")))
    if not changed:
        typer.echo("Everything is there already.")
    if closed and is_service(main):
        names = " ".join(closed)
        typer.echo(one_line(f"Next: sudo chgrp ledpi {names}; sudo chmod 640 {names}"))
    _tell_what_is_left(saved, main, rule_changed=any(file.kind == "udev rule" for _, file in changed))


def _tell_what_is_left(saved: Backup, main: Path, *, rule_changed: bool) -> None:
    """Says what a person must do: no password is in a backup, and no unit is enabled by it."""
    for _, raw in saved.configurations():
        for key, path in passwords(raw):
            file = meant(main, path)
            if not os.path.exists(file):
                command = f"sudo install -m 640 -g ledpi /dev/stdin {shlex.quote(str(file))}"
                typer.echo(one_line(f"Missing: {file}, the password of {key}: {command}"))
    if rule_changed:
        typer.echo("Next: sudo udevadm control --reload; sudo udevadm trigger --subsystem-match=tty")
    if saved.units and is_service(main):
        units = " ".join(saved.units)
        typer.echo(f"Next: sudo systemctl enable {units}; sudo systemctl restart {units}")
