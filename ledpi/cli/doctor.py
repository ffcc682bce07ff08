"""`ledpi doctor`: whether the daemon would run here, and what is in its way."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ledpi.cli import app
from ledpi.core.errors import LedpiError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ledpi.tools.doctor.finding import Finding

MARKS = {"ok": "✓", "bad": "✗", "unknown": "·"}


@app.command()
def doctor(
    config: Path | None = typer.Option(None, "--config", help="Default: ./config.yaml, /etc/ledpi/config.yaml."),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Overrides a key of the configuration."),
    as_json: bool = typer.Option(False, "--json", help="One JSON object, with a list of findings."),
) -> None:
    """One page of ✓ and ✗, each ✗ with what to do.

    · means: could not be checked, or may be fine. It also looks for panels, and says why one is not read. If a daemon
    here has the camera, the daemon is asked; otherwise the camera must be free. Exit status 0 if `ledpi run` would
    run with this configuration, else 1.

    Example: ledpi doctor --config /etc/ledpi/config.yaml
    """
    findings = []
    for finding in _findings(config, set_):
        findings.append(finding)
        if not as_json:
            typer.echo(line(finding))
    would_run = not any(finding.stops_daemon for finding in findings)
    if as_json:
        typer.echo(json.dumps({"would_run": would_run, "findings": [asdict(finding) for finding in findings]}))
    else:
        typer.echo(verdict(findings))
    raise typer.Exit(0 if would_run else 1)


def _findings(config: Path | None, set_: list[str]) -> Iterator[Finding]:
    from ledpi.config.settings import find_config, load_config
    from ledpi.tools.doctor.checks import configuration, examine
    from ledpi.tools.doctor.finding import bad

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


def verdict(findings: list[Finding]) -> str:
    """The page's last line: whether the daemon would run, and what it would not do well."""
    wrong = [finding for finding in findings if finding.state == "bad"]
    stoppers = [finding.name for finding in wrong if finding.stops_daemon]
    others = [finding.name for finding in wrong if not finding.stops_daemon]
    if stoppers:
        return f"`ledpi run` would not run: {', '.join(stoppers)}"
    return "`ledpi run` would run" + (f", but see to its ✗: {', '.join(others)}" if others else "")


def line(finding: Finding) -> str:
    """As in `✗ serial port        /dev/ledpi-controller: …`, and a second line with the remedy."""
    said = f"{MARKS[finding.state]} {finding.name:<18} {finding.said}"
    return f"{said}\n  {'':<18} → {finding.remedy}" if finding.remedy else said
