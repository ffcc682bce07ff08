"""`ledpi calibrate`: what is calibrated, how well, what comes next; what its commands share; `calibrate board`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date, datetime
from pathlib import Path
from typing import Any

import typer

from ledpi.camera.recording.picture import MAX_BYTES, decode_grey
from ledpi.cli import CONFIG, app
from ledpi.config.camera_yaml import load_intrinsics, own_section
from ledpi.config.check import unreadable_note
from ledpi.config.map_yaml import load_map
from ledpi.config.settings import Config, find_config, load_config
from ledpi.core.errors import CalibrationError, ConfigError
from ledpi.core.files import read_bytes
from ledpi.core.records import Pixels
from ledpi.core.wording import StrEnum, counted
from ledpi.workshop.calibrate.board_sheet import sheet_pdf
from ledpi.workshop.calibrate.boards import Board, Kind
from ledpi.workshop.calibrate.files import Key, change_config, write_keeping_old

calibrate = typer.Typer(rich_markup_mode=None)
app.add_typer(calibrate, name="calibrate")


@calibrate.callback(invoke_without_command=True)
def status(context: typer.Context, config: Path | None = CONFIG) -> None:
    """Measure the camera and the panels. Without a command: what is calibrated, how well, and what comes next.

    Example: ledpi calibrate
    """
    if context.invoked_subcommand is not None:
        return
    settings, file = settings_for(config, [], None)
    typer.echo(
        f"{file}:" if file is not None else "no config.yaml; these are the defaults (ledpi config init writes one)"
    )
    found = [part(settings, date.today()) for part in (_lens, _shutter, _panels, _map)]  # as they build on each other
    for part in found:
        typer.echo(f"  {part.name:8} {part.text}")
    command = next((part.command for part in found if not part.done), None)
    typer.echo(f"next: {command}" if command is not None else "nothing is missing")


def settings_for(config: Path | None, set_: list[str], recording: Path | None) -> tuple[Config, Path | None]:
    """The configuration, with a recording as its camera if one is given, and the file that it came from."""
    file = find_config(config)
    overrides = (*set_, *([] if recording is None else [f"camera.source=recording:{recording}"]))
    own_size = ("panels.side_m=1",)  # it has no part in what is measured here
    return load_config(file, overrides, without_file=own_size), file


def name_in_config(file: Path, key: tuple[str, ...], written: Path) -> str:
    """Puts the name of a file that was written into the configuration; what to say of that."""
    beside = written.resolve().parent == file.resolve().parent  # paths in the file are relative to it
    place = written.name if beside else str(written.resolve())
    return change(file, {key: place}, f"{'.'.join(key)}: {place}")


def change(file: Path, changes: Mapping[Key, Any], what: str) -> str:
    """Changes keys of a file; what to say of that."""
    return f"{file}: {what} written; the older one is kept as {change_config(file, changes)}"


def older(kept: Path | None) -> str:
    """Says where the file is that was there before."""
    return f"; the older one is kept as {kept}" if kept else ""


def read_grey(path: Path) -> Pixels:
    """A picture file as grey values (H, W). Raises CalibrationError where it is none."""
    picture = decode_grey(read_bytes(path, CalibrationError, MAX_BYTES))
    if picture is None:
        raise CalibrationError(f"{path}: is not a picture that can be decoded")
    return picture


# As `ledpi calibrate camera` looks for it, too: who takes both as they come has one board.
DEFAULT_KIND, DEFAULT_COLS, DEFAULT_ROWS = Kind.CHARUCO, 6, 5


class PaperName(StrEnum):
    """The values of --paper."""

    A4 = "a4"
    LETTER = "letter"


@calibrate.command()
def board(
    out: Path = typer.Argument(Path("board.pdf"), metavar="OUT", help="PDF to write; an older one is kept."),
    kind: Kind = typer.Option(DEFAULT_KIND, help="charuco may be partly out of view."),
    cols: int = typer.Option(DEFAULT_COLS, min=3, max=20, help="Inner corners along the long side."),
    rows: int = typer.Option(DEFAULT_ROWS, min=3, max=20, help="Inner corners along the short side."),
    square_mm: float = typer.Option(30.0, min=1, help="Side of a square."),
    paper: PaperName = typer.Option(PaperName.A4, help="Landscape."),
) -> None:
    """A ChArUco board or chessboard as a PDF, true to scale. Print at 100 %, and glue onto something flat and stiff.

    The ruler below the board is 100 mm long. If it measures anything else on paper, the printer has scaled the page.

    Example: ledpi calibrate board board.pdf --kind chessboard --paper letter
    """
    if out.suffix.lower() != ".pdf":
        raise CalibrationError(f"{out}: must end in .pdf")
    command = f"ledpi calibrate camera --board {kind} --cols {cols} --rows {rows}"
    caption = f"100 mm. Squares of {square_mm:g} mm. {command}"
    drawn = sheet_pdf(Board(columns=cols, rows=rows, kind=kind), square_mm, paper.value, caption)
    kept = write_keeping_old(out, drawn)
    typer.echo(f"{out} written{older(kept)}")
    typer.echo(f"print it at 100 %, check the ruler, then: {command}")


OLD_DAYS = 365  # a lens that was never touched does not change; one that was knocked does


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One thing that can be calibrated."""

    name: str
    text: str
    done: bool
    command: str  # that calibrates it


def _lens(config: Config, today: date) -> Part:
    path = config.camera.intrinsics
    command = "ledpi calibrate camera (a board to print: ledpi calibrate board)"
    if path is None:
        return Part(name="camera", text="no camera.intrinsics: IDs, but no poses", done=False, command=command)
    try:
        lens = load_intrinsics(path, (config.camera.width, config.camera.height))
    except CalibrationError as error:
        return Part(name="camera", text=str(error), done=False, command=command)
    own = own_section(path)
    quality = [f"{lens.width} × {lens.height}"]
    if _is_number(own.get("rms_px")):
        quality.append(f"rms {own['rms_px']:.3f} px of {own.get('views', '?')} views")
    if isinstance(deviations := own.get("deviations"), dict) and _is_number(deviations.get("fx")):
        quality.append(f"fx {lens.fx:.1f} ± {deviations['fx']:g} px")
    day = own.get("calibrated") or _changed(path)
    text = f"{path}: {', '.join(quality)}, {_age(day, today)}"
    return Part(name="camera", text=text, done=not _is_old(day, today), command=command)


def _shutter(config: Config, today: date) -> Part:
    path = config.camera.intrinsics
    measured = own_section(path).get("shutter") if path is not None else None
    used = config.camera.row_time_us
    text = "row time: what the driver says" if used == "auto" else f"row time: {used:g} µs, set in the configuration"
    noted = isinstance(measured, dict) and _is_number(measured.get("row_time_us"))
    if noted and measured is not None:
        sigma = measured.get("row_time_sigma_us", "?")
        text += f"; measured {measured['row_time_us']:g} ± {sigma} µs, {_age(measured.get('measured'), today)}"
    elif used == "auto":
        text += ", never measured"
    done = used != "auto" or noted
    return Part(name="shutter", text=text, done=done, command="ledpi calibrate shutter (before a panel with a crystal)")


def _panels(config: Config, today: date) -> Part:
    panels, common = config.panels, config.panels.spec()
    measured = {i: o.measured for i, o in sorted(panels.overrides.items()) if o.measured is not None}
    texts = []
    for marker_id, day in measured.items():
        spec = panels.spec(marker_id)
        value = "as announced" if spec.waves_hz == common.waves_hz else spec.blinking()
        texts.append(f"{marker_id}: {value}, {_age(day, today)}")
    rest = "others not" if measured else "none"
    texts.append(f"{rest} measured; announced are {common.blinking()}")
    command = "ledpi calibrate panel (before each of them)"
    return Part(name="panels", text="; ".join(texts), done=bool(measured), command=command)


def _map(config: Config, today: date) -> Part:
    command = "ledpi calibrate map"
    if config.map is None:
        return Part(name="map", text="no map: poses of panels, but none of the robot", done=False, command=command)
    try:
        panels = load_map(config.map)
    except ConfigError as error:
        return Part(name="map", text=str(error), done=False, command=command)
    text = f"{config.map}: {counted(len(panels), 'panel')}, {_age(_changed(config.map), today)}"
    strangers = unreadable_note(config.panels, panels, config.map)
    return Part(name="map", text="; ".join(filter(None, (text, strangers))), done=not strangers, command=command)


def _is_number(value: Any) -> bool:
    """A person may have edited the file; what is none is passed over."""
    return isinstance(value, (int, float))


def _changed(path: Path) -> date:
    return datetime.fromtimestamp(path.stat().st_mtime).date()


def _is_old(day: Any, today: date) -> bool:
    return isinstance(day, date) and (today - day).days > OLD_DAYS


def _age(day: Any, today: date) -> str:
    if not isinstance(day, date):
        return "of unknown age"
    days = (today - day).days
    return "of today" if days <= 0 else f"{counted(days, 'day')} old"
