"""`ledpi backup` and `ledpi restore`: configuration, lens, map and udev rule, in one file."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ledpi.cli import app
from ledpi.core.errors import ConfigError
from ledpi.core.wording import one_line

if TYPE_CHECKING:
    from ledpi.tools.backup import Kept


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
    from ledpi.core.files import read_bytes
    from ledpi.tools.backup import targets, unpack
    from ledpi.tools.calibrate.files import check_writable, write_keeping_old

    saved = unpack(path)
    _check(path, saved.files)
    where = targets(saved, find_config(config) or Path("config.yaml"))
    typer.echo(f"{path}: made {saved.made} by ledpi {saved.made_by}")
    changed = [(to, file) for to, file in where if not to.is_file() or read_bytes(to, ConfigError) != file.content]
    for to, _ in changed:
        if not to.parent.is_dir():
            raise ConfigError(f"{to}: there is no folder {to.parent}; make it first")
    check_writable(*(to for to, _ in changed))
    for to, file in changed:
        kept = write_keeping_old(to, file.content)
        typer.echo(one_line(f"{file.kind}: {to}" + (f"; the older one is {kept}" if kept is not None else "")))
    if not changed:
        typer.echo("Everything is there already.")
    elif any(file.kind == "udev rule" for _, file in changed):
        typer.echo("Next: sudo udevadm control --reload; sudo udevadm trigger --subsystem-match=tty")


def _check(path: Path, files: list[Kept]) -> None:
    """Raises ConfigError where what is restored would be wrong: tried in a folder of its own."""
    from ledpi.config.check import mistakes_in
    from ledpi.markers.dictionaries import FILE_ENDINGS
    from ledpi.tools.backup import CONFIG, KEYS, RULE

    with tempfile.TemporaryDirectory(prefix="ledpi-restore-") as name:
        overrides = []
        for number, file in enumerate(files):
            tried = Path(name) / f"{number}-{file.kind}{next(filter(file.path.endswith, FILE_ENDINGS), '.yaml')}"
            tried.write_bytes(file.content)
            if file.kind == CONFIG:
                config = tried
            elif file.kind != RULE:
                overrides.append(f"{KEYS[file.kind]}={tried}")
        if mistakes := mistakes_in(config, overrides):
            raise ConfigError(f"{path}: {'; '.join(mistakes).replace(f'{name}/', '')}")
