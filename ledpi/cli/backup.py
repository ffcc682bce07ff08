"""`ledpi backup` and `ledpi restore`: configuration, lens, map and udev rule, in one file."""

from __future__ import annotations

from pathlib import Path

import typer

from ledpi.cli import app
from ledpi.core.wording import one_line


@app.command()
def backup(
    out: Path = typer.Argument(metavar="FILE", help="File to write. An older one is kept as FILE.bak-1."),
    config: Path | None = typer.Option(None, "--config", help="Default: ./config.yaml, /etc/ledpi/config.yaml."),
) -> None:
    """Configuration, lens, map, dictionary and udev rule → one file.

    The calibration of single panels is part of the configuration. `ledpi restore` puts everything back, on this
    computer or another. Only its owner can read the file, since the configuration may hold the page's token.

    Example: ledpi backup robot.ledpi
    """
    from ledpi.config.settings import found_config
    from ledpi.tools.backup import collect, pack, rules_left_out
    from ledpi.tools.calibrate.files import write_keeping_old

    files = collect(found_config(config))
    kept = write_keeping_old(out, pack(files), mode=0o600)
    for file in files:
        typer.echo(f"{file.kind}: {file.path or found_config(config)}")
    for rule in rules_left_out(files):
        typer.echo(
            f"{rule}: is not in the backup, as it is not ledpi's own udev rule with your values; keep it yourself"
        )
    typer.echo(f"{out}: written" + (f"; the older one is {kept}" if kept is not None else ""))


@app.command()
def restore(
    path: Path = typer.Argument(metavar="FILE", help="File that `ledpi backup` wrote."),
    config: Path | None = typer.Option(
        None, "--config", help="Configuration to write. Default: the one that is read here, else ./config.yaml."
    ),
) -> None:
    """Put back what `ledpi backup` saved.

    Lens, map and dictionary go where the configuration inside names them: in its folder, below it or in /var/lib/ledpi.
    A udev rule must be ledpi's own, with your values filled in. Everything is checked before anything is written,
    and each older file is kept as NAME.bak-1.

    Example: ledpi restore robot.ledpi --config /etc/ledpi/config.yaml
    """
    from ledpi.config.settings import find_config
    from ledpi.core.errors import ConfigError
    from ledpi.core.files import read_bytes
    from ledpi.tools.backup import MAX_BYTES, RULE, to_write, unpack
    from ledpi.tools.calibrate.files import write_keeping_old

    saved = unpack(read_bytes(path, ConfigError, MAX_BYTES), path)
    changed = to_write(saved, find_config(config) or Path("config.yaml"), path)
    typer.echo(f"{path}: made {saved.made} by ledpi {saved.made_by}")
    for to, file in changed:
        kept = write_keeping_old(to, file.content)
        typer.echo(one_line(f"{file.kind}: {to}" + (f"; the older one is {kept}" if kept is not None else "")))
    if not changed:
        typer.echo("Everything is there already.")
    elif any(file.kind == RULE for _, file in changed):
        typer.echo("Next: sudo udevadm control --reload; sudo udevadm trigger --subsystem-match=tty")
