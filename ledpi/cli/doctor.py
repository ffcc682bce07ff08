"""`ledpi doctor`: whether the daemon would run here, and what is in its way."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import typer

from ledpi.cli import CONFIG, SET, app
from ledpi.config.settings import find_config, load_config
from ledpi.core.errors import LedpiError
from ledpi.workshop.doctor.checks import configuration, examine
from ledpi.workshop.doctor.finding import Finding, bad, show


@app.command()
def doctor(
    config: Path | None = CONFIG,
    set_: list[str] = SET,
    as_json: bool = typer.Option(False, "--json", help="One JSON object, with a list of findings."),
) -> None:
    """One page of ✓ and ✗, each ✗ with what to do.

    · means: could not be checked, or may be fine. It also looks for panels, and says why one is not read. If a daemon
    here has the camera, the daemon is asked; otherwise the camera must be free. Exit status 0 if `ledpi run` would
    run with this configuration, else 1.

    Example: ledpi doctor --config /etc/ledpi/config.yaml
    """
    raise typer.Exit(show(_findings(config, set_), as_json=as_json))


def _findings(config: Path | None, set_: list[str]) -> Iterator[Finding]:
    file = find_config(config)
    try:
        settings = load_config(file, tuple(set_))
    except LedpiError as error:
        yield bad("configuration", str(error), _remedy(file), stops_daemon=True)
        if file is None and not set_:  # the rest of the page, of the defaults
            yield from examine(load_config(None, without_file=("panels.side_m=1",)), is_given=False)
        return
    yield configuration(file, asked_for=config is not None)
    yield from examine(settings)


def _remedy(file: Path | None) -> str:
    if file is None:
        return "ledpi config init --set panels.side_m=0.16   (the lit grid's outer edge, in metres)"
    return f"correct it; `ledpi config check --config {file}` lists all mistakes"
