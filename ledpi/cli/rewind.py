"""`ledpi rewind`: what the running daemon has just seen, as a recording."""

from __future__ import annotations

import shutil
from pathlib import Path

import typer

from ledpi.cli import app
from ledpi.core.errors import RecordingError
from ledpi.core.files import not_written
from ledpi.daemon.tap.client import connect

PATIENCE_S = 600.0  # ten seconds of frames are written in ten to thirty, and others may be written before


@app.command()
def rewind(
    out: Path | None = typer.Argument(
        None, metavar="[OUT]", help="Folder for a copy: new, or empty. Default: no copy."
    ),
    tap: str = typer.Option("auto", "--tap", metavar="SOCKET", help="The daemon's tap.socket."),
) -> None:
    """Save the running daemon's last seconds as a recording.

    The daemon goes on meanwhile. It writes to its own folder (/var/lib/ledpi-takes for the service). With OUT, the
    recording is then copied there; use sudo for a service, since only root can read its folder. `ledpi decode --as-live
    OUT` gives what was decoded live; its first second may differ. Without a tap: systemctl kill -s USR1 ledpi.

    Example: ledpi rewind takes/what-was-that
    """
    if out is not None:
        _check_new(out)
    with connect(tap) as daemon:
        answer = daemon.ask("save", PATIENCE_S)
    saved = Path(str(answer.get("path")))
    if out is None:
        typer.echo(saved)
        return
    try:
        _copy(saved, out)
    except OSError as error:
        what = f"the recording was saved as {saved}, but cannot be copied: {error.filename}"
        raise not_written(out, error, RecordingError, what=what) from None
    typer.echo(out)


def _check_new(out: Path) -> None:
    """Before the daemon is asked: it forgets what it has saved. Raises RecordingError."""
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise RecordingError(f"{out}: is there already; a recording needs a new or an empty folder")


def _copy(saved: Path, out: Path) -> None:
    """File by file; so that what cannot be read is named alone, and no owner or mode comes along."""
    for path in sorted(saved.rglob("*")):
        to = out / path.relative_to(saved)
        if path.is_dir():
            to.mkdir(parents=True, exist_ok=True)
        else:
            to.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, to)
    if not (out / "recording.yaml").exists():
        raise PermissionError(13, "only root may read it; run it with sudo", str(saved))
