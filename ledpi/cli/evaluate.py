"""`ledpi evaluate`: how often a real panel is read, from places that are given."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Any, TypeVar

import typer

from ledpi.camera.recorded import load_recording_with
from ledpi.cli import SET, app, progress
from ledpi.config.camera_yaml import lens_of
from ledpi.config.overrides import METHODS, current_name
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import Config, check_method, load_config
from ledpi.core.errors import ConfigError
from ledpi.core.wording import StrEnum
from ledpi.workshop.evaluate.page import PAGE_FILE, ResultsFolder, code_version, summary, write_results
from ledpi.workshop.evaluate.scoring import PANEL_METHODS, PanelMethod
from ledpi.workshop.evaluate.table import TableRow, evaluate_recording, rows_of_recordings

Name = TypeVar("Name", bound=StrEnum)
SIDE = "panels.side_m=0.16"
SIMULATED = "simulated panels are measured by `python -m evaluation.suites`, in a clone of ledpi's source"


class MethodName(StrEnum):
    """The values of --method."""

    UEMURA = "uemura"
    LIKELIHOOD = "likelihood"
    STREAM = "stream"


def method_option(names: type[Name], renamed: dict[str, str], default: str) -> Any:
    """The option --method, which also takes the names that methods had before."""

    def parse(name: str) -> Name:
        try:
            return names(current_name(name, renamed, "--method"))
        except ValueError:
            known = ", ".join(f"'{known}'" for known in names)
            raise typer.BadParameter(f"'{name}' is not one of {known}.") from None

    metavar = f"[{'|'.join(names)}]"
    return typer.Option([], "--method", parser=parse, metavar=metavar, help=f"May be repeated. Default: {default}.")


_METHOD = method_option(MethodName, METHODS, "all")


@app.command()
def evaluate(
    out: Path = typer.Option(
        Path("evaluation"), "--out", metavar="DIR", help="Folder for the results. Each run adds its place to them."
    ),
    recording: Path | None = typer.Option(None, metavar="DIR", help="Frames of a real panel."),
    id_: int | None = typer.Option(None, "--id", min=0, help="The panel's ID."),
    distance: list[float] = typer.Option([], min=0.05, max=1000, help="In metres, from camera to panel."),
    angle: list[float] = typer.Option(
        [], min=-88, max=88, help="In degrees, between the panel's normal and the line of sight. Default: 0."
    ),
    method: list[MethodName] = _METHOD,
    config: Path | None = typer.Option(
        None, "--config", help="Take the panels from this file. Default: the paper's, 16 cm."
    ),
    set_: list[str] = SET,
    suite: list[str] = typer.Option([], hidden=True),
) -> None:
    """Measure how often and how exactly your own panel is read.

    Its frames come from a recording, from a distance and an angle that you give. Results go to DIR: results.csv,
    evaluation.md, plots. Simulated panels are measured by `python -m evaluation.suites`, in a clone of ledpi's source.

    Example: ledpi evaluate --out mine --recording take1 --id 7 --distance 0.6
    """
    if suite:
        raise ConfigError(f"--suite {suite[0]}: {SIMULATED}")
    if recording is None:
        raise ConfigError(f"--recording: must be given: the folder of a real panel's frames; {SIMULATED}")
    if id_ is None:
        raise ConfigError("--id: must be given with --recording: its panel's")
    settings = load_config(config, tuple(set_), without_file=(SIDE,))
    place = _one("--distance", distance), _one("--angle", angle or [0.0])
    methods: list[PanelMethod] = [each.value for each in method]
    _read_recording(out, recording, id_, *place, methods, settings, panel_options(config, set_))


def panel_options(config: Path | None, set_: list[str]) -> list[str]:
    """The words of a command line that the panels came from."""
    return ([] if config is None else ["--config", str(config)]) + [word for item in set_ for word in ("--set", item)]


def _one(name: str, values: list[float]) -> float:
    if len(values) != 1:
        raise ConfigError(f"{name}: must be given once with --recording: where its panel was")
    return values[0]


def _read_recording(
    out: Path,
    recording: Path,
    marker_id: int,
    distance_m: float,
    angle_deg: float,
    methods: list[PanelMethod],
    settings: Config,
    panel_words: list[str],
) -> None:
    folder = ResultsFolder(out, {"recordings": True, "code": code_version()})
    loaded = load_recording_with(settings, recording)
    lens = lens_of(loaded.camera, settings.camera.intrinsics)
    with progress("evaluating", len(loaded.frames)) as advance:
        record = evaluate_recording(
            loaded,
            marker_id=marker_id,
            distance_m=distance_m,
            angle_deg=angle_deg,
            methods=_able(methods, settings.panels.override_with(loaded.panel_values)),
            intrinsics=lens,
            panels=settings.panels,
            advance=advance,
        )
    place = ["--id", str(marker_id), "--distance", f"{distance_m:g}", "--angle", f"{angle_deg:g}"]
    chosen = [word for m in methods for word in ("--method", m)] + panel_words
    words = ["ledpi", "evaluate", "--out", "DIR", "--recording", str(recording), *place, *chosen]
    folder.add(record | {"command": shlex.join(words)})
    _show(out, folder)


def _able(asked: list[PanelMethod], panels: PanelSettings) -> list[PanelMethod]:
    """Those asked for, else all that can read such panels. Raises ConfigError where one that is asked for cannot."""
    if "uemura" in asked:
        check_method("uemura", panels, "--method")
    able = [m for m in PANEL_METHODS if m != "uemura" or not panels.has_antiphase()]
    return [m for m in able if m in (asked or able)]


def _show(out: Path, folder: ResultsFolder) -> None:
    """The table of all places that the folder holds."""
    records = folder.finished.values()

    def commands(row: TableRow) -> list[str]:
        return [r["command"] for r in records if (r["exposure_us"], r["transfer"]) == (row.exposure_us, row.transfer)]

    rows = rows_of_recordings(records)
    for note in write_results(out, rows, f"Read from recordings, code {code_version()}.", commands):
        print(f"ledpi: {note}", file=sys.stderr)
    print(summary(rows))
    print(f"The tables and the plots: {out / PAGE_FILE}")
