"""`ledpi config …`: writes, shows, checks and changes config.yaml."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import typer

from ledpi.cli import CONFIG, SET, app
from ledpi.config.check import mistakes_in, mistakes_in_text
from ledpi.config.origins import origins_of, values_of
from ledpi.config.overrides import Key, parse_override
from ledpi.config.settings import find_config, found_config, load_config
from ledpi.config.shipped import copy_files, example
from ledpi.core.errors import ConfigError
from ledpi.core.linux import lost_at_reboot
from ledpi.core.wording import counted
from ledpi.daemon.reporting import log_to_standard_error
from ledpi.workshop.calibrate.files import changed_yaml, write_keeping_old
from ledpi.workshop.editing import passed_socket, serve_edits, set_keys

SERVICE_FILE = Path("/etc/ledpi/config.yaml")

config_app = typer.Typer(
    name="config",
    help="Write, show, check and change config.yaml.\n\nExample: ledpi config init --set panels.side_m=0.16",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(config_app)


@config_app.command()
def init(
    out: Path = typer.Argument(Path("config.yaml"), metavar="FILE", help="File to write. It must not exist."),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Changes a key in the file."),
    files: Path | None = typer.Option(
        None, "--files", metavar="FOLDER", help="New folder for the examples, the service and the udev rule."
    ),
) -> None:
    """Write a commented config.yaml with every key and its default.

    --set changes values. --files also copies the examples, the service's units and the udev rule.

    Example: ledpi config init --set panels.side_m=0.16
    """
    if out.exists() or out.is_symlink():
        raise ConfigError(f"{out}: is there already; `ledpi config set KEY=VALUE` changes it")
    if not out.parent.is_dir():
        raise ConfigError(f"{out}: there is no folder {out.parent}; make it first")
    text = example()
    if set_:
        text = changed_yaml(text, _changes(set_))
    if mistakes := mistakes_in_text(text, "--set"):
        raise ConfigError(mistakes[0])
    if files is not None:
        copy_files(files)
    write_keeping_old(out, text)
    typer.echo(f"{out}: written")
    if files is not None:
        typer.echo(f"{files}: examples, systemd units and udev rule")
    if not any(item.partition("=")[0] == "panels.side_m" for item in set_):
        typer.echo("Next: measure the outer edge of the lit grid, and say so: ledpi config set panels.side_m=0.16")
    typer.echo("Then: ledpi doctor")


@config_app.command()
def show(
    config: Path | None = CONFIG,
    set_: list[str] = SET,
    as_json: bool = typer.Option(False, "--json", help="One JSON object: values and origins by key."),
) -> None:
    """Each key with its value, and where that comes from.

    A value comes from the file, --set or the default. Tokens are not shown.

    Example: ledpi config show --config /etc/ledpi/config.yaml
    """
    settings = load_config(find_config(config), tuple(set_))
    values, origins = values_of(settings), origins_of(settings)
    if as_json:
        typer.echo(json.dumps({key: {"value": values[key], "from": origins[key]} for key in values}))
        return
    texts = {key: _text(_without_null(value)) for key, value in values.items()}
    wide, long = max(map(len, texts)), min(40, max(map(len, texts.values())))
    for key, text in texts.items():
        typer.echo(f"{key:<{wide}}  {text:<{long}}  {origins[key]}")


@config_app.command()
def check(config: Path | None = CONFIG, set_: list[str] = SET) -> None:
    """List all mistakes of a configuration at once.

    Wrong keys and values, and mistakes in the files that it names: lens, map, those of outputs. Exit status 2 if there
    are any. `ledpi doctor` also looks at the machine and the camera.

    Example: ledpi config check --config /etc/ledpi/config.yaml
    """
    file = found_config(config)
    mistakes = mistakes_in(file, set_)
    for mistake in mistakes:
        typer.echo(mistake)
    typer.echo(f"{file}: {counted(len(mistakes), 'mistake') if mistakes else 'OK'}")
    raise typer.Exit(2 if mistakes else 0)


@config_app.command("set")
def set_values(
    items: list[str] = typer.Argument(metavar="KEY=VALUE…", help="Keys, with their new values in YAML."),
    config: Path | None = CONFIG,
) -> None:
    """Change keys of config.yaml. Comments and all other keys stay.

    Nothing is written unless the whole file is right afterwards. The older file is kept as config.yaml.bak-1.

    Example: ledpi config set panels.side_m=0.158 panels.ids=[7,23]
    """
    file = found_config(config)
    kept = set_keys(file, items)
    for key, value in _changes(items).items():
        typer.echo(f"{file}: {'.'.join(map(str, key))}: {_text(value)}")
    typer.echo(f"The older file is {kept}.")
    if lost := lost_at_reboot(file):
        typer.echo(lost)
    if file.absolute() == SERVICE_FILE:
        typer.echo("Next: sudo systemctl reload ledpi")


@config_app.command()
def serve(config: Path = typer.Option(SERVICE_FILE, "--config", help="The file that may be changed.")) -> None:
    """Change config.yaml for the live page, whose service may not.

    systemd starts this, by ledpi-edit.socket. It answers only if `view.edit` is true in the file, and ends when nobody
    has asked for half a minute.

    Example: ledpi config serve --config /etc/ledpi/config.yaml
    """
    log_to_standard_error()
    with passed_socket() as listener:
        serve_edits(config, listener)


def _changes(items: list[str]) -> dict[Key, Any]:
    return dict(parse_override(item) for item in items)


def _without_null(value: object) -> object:
    """Leaves of panels that differ only what differs."""
    if not isinstance(value, dict):
        return value
    return {key: _without_null(part) for key, part in value.items() if part is not None}


def _text(value: object) -> str:
    """As YAML takes it, in one line."""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
